"""Machine code: kernels compiled by Numba or LLVM, how they are keyed, kept and loaded.

The room knows nothing of what is computed. A file of its cache is used only if it
belongs to this user, and its key covers the code, the libraries and the processor.
"""
