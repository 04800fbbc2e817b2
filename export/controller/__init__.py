"""A receding-horizon controller as one C99 file.

c_writer     lines of C, by the methods with which machine code is written
c_functions  kernels and functions of a problem as C functions
numbers      constants that the C file and its twin share
posed        a controller as the numbers and functions that a C file needs
source       the text of the C files, from controller.c
twin         the same controller by the library's own code, to compare with
exported     the C file, compiled on this machine and called
files        `export_c`, which writes all of it
fmu          the same as an FMU
"""
