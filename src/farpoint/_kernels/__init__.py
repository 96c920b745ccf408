"""Compiled loops, which take plain arrays and write into buffers of the caller.

Loops of the two-view estimator, and those that kernels of several packages call. The kernels that
one other package uses are in the folder ``kernels`` of that package. The modules of this package
import only numpy and numba.
"""
