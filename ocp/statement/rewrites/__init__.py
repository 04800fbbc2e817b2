"""Rewrites of a problem to its core, one file a feature; chain.py composes them."""
