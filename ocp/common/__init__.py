"""What every room of `ocp` uses: errors, limits, expressions, units, progress."""
