"""Trials: one solver on one problem with one seed, a budget and a history."""
