"""Moving polytopes that hold every admissible trajectory."""
