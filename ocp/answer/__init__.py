"""Answers: plans and planners, `solve` with its improvements, repair and verification.

A plan is what a solver found; a `Solution` is a plan that was checked on a finer path.
"""
