"""Named constants of `farpoint.tracks`: meaning, unit and origin.

The origin is "derived" (from what), "convention", "measured" (by what), or "chosen" if no other
origin is known.
"""

from __future__ import annotations

import numpy as np

# --- Windows and warps

# Largest width of a window, px: time and memory are quadratic in the width. Chosen.
MAX_WINDOW_PX = 255

# Step, px, of the central differences of a predicted motion. Chosen: about half of the half width
# of a window.
WARP_STEP_PX = 4.0

# Deviation of an element of a predicted warp from the identity, from which on the identity is used.
# Chosen: larger deviations occur at the seam of a panorama or at the border of the lens' field.
MAX_PREDICTED_WARP = 0.5

# 1-sigma error of a match, px, due to 8-bit quantisation and bilinear interpolation, which a
# covariance from residuals underestimates. Measured on noise-free images of known sub-pixel shift;
# the command is not recorded.
INTERPOLATION_SIGMA_PX = 0.01

# Sampling distance of the field of the lens, px. Chosen: 16 times faster than a distance of 1 px,
# while the region becomes only 4 px narrower.
FIELD_STEP_PX = 4

# --- Start level of Lucas-Kanade

# Number of points that are tracked first, as probes: the displacements of the probes select the
# start level of the other points. Chosen.
PROBES = 40

# Least number of probes that are found. With fewer, the other points start at the coarsest level.
# Chosen.
MIN_PROBES = 10

# Least share of probes that are found. With a smaller share, the other points start at the coarsest
# level. Chosen.
MIN_FOUND_SHARE = 0.5

# The start level is selected from this quantile of the displacements of the probes. Chosen.
PROBE_QUANTILE = 0.9

# Least ratio of the half width of the window at the start level, in px of the finest level, to this
# quantile. Chosen: Lucas-Kanade converges reliably only within a part of the window.
REACH_MARGIN = 4.0

# --- Defective pixels

# Distance, px, to which demosaicing and compression spread a defective pixel. Chosen.
DEFECT_REACH_PX = 1

# Distance from a pixel, px, of the square ring of pixels with which the pixel is compared and from
# which a defect is interpolated. Derived: the nearest pixels that a defect does not change.
DEFECT_RING_PX = DEFECT_REACH_PX + 1

# Least difference, grey levels, between a suspect and every pixel of its ring. Chosen: a smaller
# difference hardly biases a match.
MIN_DEFECT_CONTRAST = 6

# Of the first images, in this number, every image is tested for defects. Chosen.
FIRST_IMAGES = 20

# Of later images, one in this number is tested for defects. Chosen: sensors age slowly.
LATER_EVERY = 4

# Image motion, px, after which a suspect is tested again. Scene content that stood out in the last
# test has then moved to another pixel. Chosen.
MIN_MOTION_PX = 1.0

# Distance along each axis, px, within which a track may follow a suspect instead of the scene.
# Chosen.
SUSPECT_PULL_PX = 5

# Number of nearest tracks whose median displacement is taken as the image motion at a pixel.
# Chosen.
MOTION_NEIGHBOURS = 5

# Probability that a defect stands out in one image. Chosen.
DETECTION_RATE = 0.8

# Expected number of pixels of an image that are wrongly classified as defective. Chosen.
FALSE_DETECTIONS = 0.01

# A defect is dropped after this number of successive tests in which the pixel does not stand out.
# Chosen.
MAX_MISSES = 6

# --- Brightness of rows

# Pyramid level whose grey values are compared. Chosen.
BRIGHTNESS_LEVEL = 1

# Number of successive tracks, in the order of their rows, of which all but the middle track predict
# the brightness change of the middle track by their median. Chosen.
ROW_NEIGHBOURS = 9

# Least number of tracks for an estimate of row gains. Chosen.
MIN_ROW_TRACKS = 4 * ROW_NEIGHBOURS

# Least median absolute deviation of the log ratios of brightness for an estimate of row gains.
# Chosen: the gain of a matched window absorbs smaller changes.
MIN_ROW_DEVIATION = 0.02

# Largest ratio of the median error of the prediction from neighbouring rows to the median absolute
# deviation of the log ratios, for an estimate of row gains. Chosen.
MAX_UNEXPLAINED = 0.6

# Largest ratio of the prediction error of an inlier to the median prediction error. Chosen.
ROW_INLIER_RATIO = 4.0

# Grey level up to which a pixel is too dark for a ratio of brightness. Chosen.
DARK_GREY = 8.0

# Number of knots of the curve of log gain over the rows. Chosen.
ROW_KNOTS = 80

# Weights of the smoothness penalty (squared second differences) of this curve that are tried.
# Chosen.
ROW_PENALTIES = 10.0 ** np.arange(-2, 5)

# Upper bound of the magnitude of a log gain. Chosen.
MAX_LOG_GAIN = 1.0

# Largest number of alternations between the estimate of row gains and matching. Chosen.
ROW_GAIN_ROUNDS = 2

# Largest number of images over which row gains are averaged. Chosen.
MAX_AVERAGED_IMAGES = 20

# --- Kernels

# Parameters of the affine match. Derived: displacement (2), warp (4), gain and offset.
AFFINE_PARAMETERS = 8

# Distance, px, by which a window may move to each side before pixels of the image are copied again.
# Chosen.
WINDOW_SLACK_PX = np.int64(1)

# Number of pixels of a line of a warped window that are interpolated in one step. Chosen.
PIXELS_AT_ONCE = 16

# Largest ratio of the half width or half height of a warped window to the half width of the window.
# Chosen.
MAX_WINDOW_STRETCH = 2.0

# Ratio of the noise variance of Scharr gradients to the noise variance of the residual. Derived: if
# the images have white noise of variance s^2, bilinear interpolation reduces the noise variance of
# the gradient from 0.23 s^2 to 0.13 s^2, and the difference of two interpolated images has the
# variance 0.88 s^2.
GRADIENT_NOISE_RATIO = 0.15

# Least distance, px, of pixels whose residuals count as independent (`window_covariance.covary`).
# Chosen. The code of `window_covariance._block_moments` requires the value 3.
RESIDUAL_BLOCK_PX = 3

# Lower bound of the singular values of the median response (`refinement._with_response`). Chosen:
# the smallest singular value in eight recordings is 0.43, during rotations of a Kinect.
MIN_RESPONSE = 0.25
