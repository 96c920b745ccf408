"""Compiled loops, which take plain arrays and write into buffers of the caller.

The modules of this package import only numpy and numba.
"""
