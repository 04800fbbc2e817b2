"""Proofs about terminal sets.

They are about the decrease of e'Pe, the growth of e'Pe between samples, the drift of a
rounded reference, and the integrator's error. `certification.py` takes all steps: it
designs a set, looks for the lowest refuted level, and proves a level below it.
"""
