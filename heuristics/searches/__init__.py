"""The searches, each a file with its settings, its state and its two kernels.

`names.py` lists them; `arguments.py` reads the arguments in which a user names one.
"""
