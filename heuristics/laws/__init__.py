"""Laws that all searches share: the box, the order of points, sampling, and descent.

A search is settings, a state and two kernels (`algorithm.py`); these are written in
terms of what is here.
"""
