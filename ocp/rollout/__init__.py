"""Rollouts: cost and violation of controls, their finer path, and what it says.

The compiled evaluator of populations is `Fitness`; `status.py` has the words for what
the finer path shows.
"""
