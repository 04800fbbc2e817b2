"""Trials: one solver on one problem with one seed, its budget and history."""
