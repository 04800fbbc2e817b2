"""Measures of a problem in YAML: those of any problem, and those that it defines."""
