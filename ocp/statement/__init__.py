"""The problem as stated, and its rewrites to a core that all solvers share.

Free end times, decided parameters, phases, ensembles and blocks are each one module.
"""
