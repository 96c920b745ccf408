"""The path of the camera on one scale: a window over keyframes that finds the lens, too."""
