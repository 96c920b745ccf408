"""Compiled loops, which take plain arrays and write into buffers of the caller.

Here are the kernels of the two-view estimator (`farpoint.pose`), and kernels that several packages
call. Kernels that only one other package calls are in the folder ``kernels`` of that package. The
modules of this package import no other package of farpoint, and of third parties only numpy and
numba.
"""
