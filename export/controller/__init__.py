"""A receding-horizon controller as one C99 file.

c_writer     lines of C by the verbs of vector code
c_functions  kernels and functions of a problem as C functions
numbers      numbers that the C file and its twin share
posed        a controller as numbers and functions
source       the text of its files, from controller.c
twin         the same controller by the library's own code
exported     its text, compiled here and called
files        the files
fmu          the same as an FMU
"""
