"""The problem as an NLP: transcription, multipliers, and the polish by an NLP solver.

A polish begins at a `Start` and ends with a status, never with an error.
"""
