"""Proven lower bounds of optimal-control problems."""
