"""A receding-horizon controller as one C99 file.

c_writer     lines of C by the verbs of vector code
c_functions  kernels and functions of a problem as C functions
posed        a controller as numbers and functions
source       the text of its files, from controller.c
"""
