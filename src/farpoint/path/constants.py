"""Every number of the path that has a name: unit, meaning and origin.

Origin is "derived" (from what), "convention", "measured" (by what), or "chosen" where nothing more
is known. Numbers that kernels of the two-view estimator use, too, are in
`farpoint._kernels.constants`.
"""

from __future__ import annotations

import math

import numpy as np

# --- Statistics

# Limit of a squared distance of 2 degrees of freedom. Derived: 0.999 quantile of chi-square.
CHI2_P999_OF_2 = 13.8

# Limit of a squared distance of 5 degrees of freedom. Derived: 0.999 quantile of chi-square.
CHI2_P999_OF_5 = 20.5

# Limit of a squared distance of 3 degrees of freedom. Derived: 0.99 quantile of chi-square.
CHI2_P99_OF_3 = 11.3

# Log-likelihood ratio that decides between two first motions. Chosen.
DECISIVE_LOG_RATIO = 2.0

# Parallax, in sigma, from which on a point has an inverse distance. Chosen.
SIGNIFICANT_PARALLAX_SIGMA = 5.0

# --- First solutions

# Iterations of the first solutions, initialised from two views. Chosen.
FIRST_ITERATIONS = 6

# Iterations of later solutions. Chosen: a new keyframe changes the others little.
LATER_ITERATIONS = 1

# 1-sigma of a displacement before initialisation, in units of the first length. Chosen.
UNKNOWN_LENGTH_SIGMA = 2.0

# Share of the keyframe flow at which the first motion is tested. Chosen.
RELIABLE_FLOW_SHARE = 0.5

# Flow of the next attempt over one from which no direction was observable. Convention.
NEXT_ATTEMPT_FLOW_RATIO = 1.25

# Number of frames kept until their keyframes leave the window. Chosen.
MAX_PENDING_FRAMES = 150

# --- Lens and shutter

# Displacement of pixels, px, beyond which derivatives by the lens are computed again. Derived: the
# linearisation error is its square over the focal length, about 0.01 px.
STALE_LENS_PX = 2.0

# 1-sigma of an unknown read-out time, over the time between frames, its upper limit. Chosen.
UNKNOWN_READOUT_SIGMA = 0.5

# 1-sigma of a known read-out time, s. Chosen: small, for regular equations.
EXACT_READOUT_SIGMA_S = 1e-9

# Largest distance of a pixel from the centre, in widths and heights of the image: a whole image
# beside the image (`LensEstimate.pixels_of`). Chosen.
FARTHEST_PIXEL = 1.5

# Columns and rows of pixels at which displacements by the lens are computed. Chosen.
LENS_GRID = (9, 7)

# --- Perspective of windows

# 1-sigma of the elements of a warp, without occlusion. Chosen.
WARP_SIGMA = 0.01

# Prior 1-sigma of the slope of a surface: derivative of log distance by angle, 1 / rad. Chosen.
SLOPE_SIGMA = 2.0

# Least metric of the tangents at a pixel, rad^2 / px^2: keeps the plane regular. Chosen.
MIN_TANGENT_METRIC = 1e-15

# Corrections of a match beyond this length, px, are discarded. Chosen.
MAX_CORRECTION_PX = 0.2

# 1-sigma of a match, px, per unit of warp misfit to a plane. Measured on rendered streets through
# four lenses; the command is not recorded.
PX_PER_WARP_MISFIT = 1.2

# Upper bound of the misfit of a warp. Chosen: the window has passed the correlation test.
MAX_WARP_MISFIT = 0.2

# --- Pose of a frame

# Factors on the residual variances, iteration by iteration, for convergence from 10 sigma; and
# whether the lens is linearised anew before them. Chosen.
RESIDUAL_INFLATIONS = (
    (np.array([100.0, 100.0, 25.0, 9.0]), False),
    (np.array([4.0, 1.0, 1.0, 1.0]), True),
)

# --- Keyframes and points

# Reciprocal of the golden ratio: low-discrepancy sampling of tracks. Derived.
GOLDEN_SHARE = (math.sqrt(5.0) - 1.0) / 2.0

# Least share of the points of a keyframe that are still in view. Chosen.
MIN_SHARE_IN_VIEW = 0.05

# Number of the newest keyframes, which are never removed. Chosen.
NEWEST_KEYFRAMES = 2

# Added to the distances between keyframes, over the median distance of the points. Chosen.
SAME_PLACE = 0.02

# Number of patches along the longer side of an image, for correlated residuals. Chosen.
PATCHES_PER_IMAGE = 4

# Least inverse distance of a point, in the inverse unit of the path. Chosen.
MIN_INVERSE_DEPTH = 1e-6

# Prior 1-sigma of the inverse distance of a new point, over the median. Chosen.
NEW_DEPTH_SIGMA = 2.0

# Damping of the information of a point, over the median inverse distance^-2. Chosen.
DEPTH_DAMPING = 1e-3

# Largest relative 1-sigma of the inverse distance of a reliable point. Chosen.
RELIABLE_DEPTH_SIGMA = 0.25

# Largest 1-sigma of the inverse distance of a far point, over the median. Chosen.
FAR_DEPTH_SIGMA = 0.1

# Largest ratio of inverse distances after and before a step. Chosen.
MAX_DEPTH_STEP_RATIO = 10.0

# --- Window

# Relative 1-sigma of the baseline that fixes the gauge of the scale. Chosen.
SCALE_GAUGE_SIGMA = 1e-4

# 1-sigma of the first pose, the gauge of poses, in rad and in the unit of the path. Chosen.
POSE_GAUGE_SIGMA = 1e-6

# Damping of the first try of a step. Chosen.
FIRST_DAMPING = 1e-6

# Factor on the damping from try to try. Chosen.
DAMPING_FACTOR = 100.0

# Upper bound of the tries of a step. Chosen.
MAX_TRIES = 3

# Bounds of the factor on the variances of residuals. Chosen.
VARIANCE_FACTOR_BOUNDS = (0.1, 100.0)

# Least number of residuals for an update of the variance factor. Chosen.
MIN_RESIDUALS = 50

# Bounds of the design effect. Chosen.
DESIGN_EFFECT_BOUNDS = (1.0, 50.0)

# Initial design effect. Measured: recordings have 1 to 4; the command is not recorded.
FIRST_DESIGN_EFFECT = 1.5

# Spurious information from linearising at noisy estimates: ratio of squared errors to variances of
# lens, shutter and path, for tracks with independent errors. Measured:
# `farpoint bench --tables lens`.
LINEARISATION_EFFECT = 2.0

# Weight of the value so far in exponential smoothing from keyframe to keyframe. Chosen.
SMOOTHING = 0.8

# --- Kernels

# Information of an unknown that no observation constrains, in place of zero, whose inverse would
# overflow. Derived: a standard deviation of 1e12 rad or units.
LEAST_INFORMATION = 1e-24

# Relative ridge on the information of a window, for poses that no point constrains. Chosen.
WINDOW_RIDGE = 1e-9

# Residual, px, of a point that is not in front of the camera. Convention: a mark.
UNSEEN_PX = 1e9

# Cost, in log likelihood, of a point behind the camera. Chosen: as a residual of many sigma.
UNSEEN_COST = 50.0

# Least cosine between a point and its prediction. Chosen.
MIN_FACING_COSINE = 0.2
