"""Close formation flight: a wingman in its leader's trailing vortex."""
