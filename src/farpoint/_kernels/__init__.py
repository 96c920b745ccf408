"""Compiled loops, which take plain arrays and write into buffers of the caller. They import numpy
and numba only.
"""
