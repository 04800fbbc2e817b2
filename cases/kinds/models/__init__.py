"""Models of a wingman in the wake of its leader."""
