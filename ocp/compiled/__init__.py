"""Evaluators of whole populations, made from an SX casadi.Function."""
