"""Running a search: budgets, the loops that drive its kernels, results, interrupts.

`minimize` is the whole way in one call, `Search` the same step by step (ask and tell).
"""
