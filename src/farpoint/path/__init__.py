"""The path of the camera on one scale, from a sliding window over keyframes.

The window also estimates lens and shutter.
"""
