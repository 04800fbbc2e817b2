"""Common ground of `ocp`: errors, limits, expressions, units, progress."""
