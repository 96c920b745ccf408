"""Trajectories: reading and writing of files."""
