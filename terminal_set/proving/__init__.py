"""Proofs that a terminal set keeps its promise: decrease, growth, drift, flow errors.

`certification.py` is the way through: design, refute from above, prove from below.
"""
