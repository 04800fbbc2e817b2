"""Integrators: a step of each, equal steps, steps with size control, collocation."""
