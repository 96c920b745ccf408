"""The path of the camera on one scale: a sliding window over keyframes that also estimates the
lens.
"""
