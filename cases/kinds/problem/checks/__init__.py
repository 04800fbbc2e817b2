"""Errors of a problem in YAML, each with its place."""
