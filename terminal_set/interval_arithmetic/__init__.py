"""Interval arithmetic: functions on boxes with outward rounding, Taylor forms, cells.

A function is a list of operations (`tape.py`), evaluated on many boxes at once.
"""
