"""Compiled loops, which take plain arrays and write into buffers of the caller.

The package has the loops of the two-view estimator, and loops that kernels of several packages
call. Kernels that only one other package uses are in the folder ``kernels`` of that package. The
modules of this package import no other package of farpoint, and of third parties only numpy and
numba.
"""
