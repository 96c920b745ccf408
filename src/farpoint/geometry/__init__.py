"""Rotations and directions: SO(3) and the unit sphere."""
