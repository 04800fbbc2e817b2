"""Measures of a problem in YAML, its own and those that it defines."""
