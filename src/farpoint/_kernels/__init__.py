"""Compiled loops: plain arrays in, caller's buffers out; imports numpy and numba only."""
