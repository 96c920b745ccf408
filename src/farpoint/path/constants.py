"""Every number of the path that has a name: unit, meaning and origin.

Origin is "derived" (from what), "convention", "measured" (by what), or "chosen" where nothing more
is known. Numbers that kernels of the two-view estimator use, too, are in
`farpoint._kernels.constants`.
"""

from __future__ import annotations

import math

import numpy as np

# --- Statistics

# Limit of a squared Mahalanobis distance with 2 degrees of freedom. Derived: 0.999 quantile of
# chi-square.
CHI2_P999_OF_2 = 13.8

# Limit of a squared Mahalanobis distance with 5 degrees of freedom. Derived: 0.999 quantile of
# chi-square.
CHI2_P999_OF_5 = 20.5

# Limit of a squared Mahalanobis distance with 3 degrees of freedom. Derived: 0.99 quantile of
# chi-square.
CHI2_P99_OF_3 = 11.3

# Log likelihood by which a two-view motion may fall short of the path's first motion and still
# replace it. Chosen.
DECISIVE_LOG_RATIO = 2.0

# Inverse distance, in sigma, above which a new point counts in the median inverse distance of the
# new points. Chosen.
SIGNIFICANT_PARALLAX_SIGMA = 5.0

# --- First solutions

# Levenberg-Marquardt iterations of a solution before the first marginalisation. Chosen.
FIRST_ITERATIONS = 6

# Levenberg-Marquardt iterations of later solutions. Chosen: a new keyframe changes the others
# little.
LATER_ITERATIONS = 1

# 1-sigma of a displacement while the scale is unknown, over the length of the segment's first
# displacement. Chosen.
UNKNOWN_LENGTH_SIGMA = 2.0

# Flow since the first keyframe over `PathOptions.keyframe_flow_px`, above which the first motion is
# tested (`first_motion.contradicting_motion`). Chosen.
RELIABLE_FLOW_SHARE = 0.5

# Least flow since the keyframe for the next estimate of a direction, over the flow of the last
# estimate without an observable direction. Convention.
NEXT_ATTEMPT_FLOW_RATIO = 1.25

# Largest number of frame poses that wait for their keyframe to leave the window. Chosen.
MAX_PENDING_FRAMES = 150

# --- Lens and shutter

# Displacement of pixels, px, beyond which derivatives by the lens are computed again. Derived: the
# linearisation error is the square of the displacement over the focal length, about 0.01 px.
STALE_LENS_PX = 2.0

# 1-sigma of an unknown read-out time over the time between frames. Chosen: a read-out takes at most
# the time between frames.
UNKNOWN_READOUT_SIGMA = 0.5

# 1-sigma of a known read-out time, s. Chosen: small, for regular equations.
EXACT_READOUT_SIGMA_S = 1e-9

# Largest distance of a predicted pixel from the image centre, in image widths (u) or heights (v): 1
# width or height outside the image (`LensEstimate.pixels_of`). Chosen.
FARTHEST_PIXEL = 1.5

# Columns and rows of the pixel grid at which the displacements by a change of the lens are
# computed. Chosen.
LENS_GRID = (9, 7)

# --- Perspective of windows

# 1-sigma of each element of the affine warp of a matched window, without occlusion. Chosen.
WARP_SIGMA = 0.01

# Prior 1-sigma of the slope of a surface: derivative of log distance by angle, 1 / rad. Chosen.
SLOPE_SIGMA = 2.0

# Added to the diagonal of ``J^T J``, rad^2 / px^2, with the derivatives J (3, 2) of a ray by the
# pixel: keeps the matrix invertible. Chosen.
MIN_TANGENT_METRIC = 1e-15

# Corrections of a match beyond this length, px, are discarded. Chosen.
MAX_CORRECTION_PX = 0.2

# 1-sigma of a match, px, over the misfit of its warp to a plane (`perspective._planes`). Measured
# on rendered streets through four lenses; the command is not recorded.
PX_PER_WARP_MISFIT = 1.2

# Upper bound of the misfit of a warp. Chosen: the window has passed the correlation test.
MAX_WARP_MISFIT = 0.2

# --- Pose of a frame

# Two runs of Gauss-Newton steps: factors on the residual variances, one for each step, and whether
# the lens is linearised anew before the run. The first factors are 100, for convergence from an
# initial error of 10 sigma. Chosen.
RESIDUAL_INFLATIONS = (
    (np.array([100.0, 100.0, 25.0, 9.0]), False),
    (np.array([4.0, 1.0, 1.0, 1.0]), True),
)

# --- Keyframes and points

# Reciprocal of the golden ratio: low-discrepancy sampling of tracks. Derived.
GOLDEN_SHARE = (math.sqrt(5.0) - 1.0) / 2.0

# Share of the points of a keyframe that are still in view, below which the keyframe is marginalised
# first. Chosen.
MIN_SHARE_IN_VIEW = 0.05

# Number of the newest keyframes, which are never removed. Chosen.
NEWEST_KEYFRAMES = 2

# Added to the distance between two keyframes, which is in units of the median distance of the
# points: keeps 1 / distance finite (`selection.redundant_keyframe`). Chosen.
SAME_PLACE = 0.02

# Number of patches along the longer side of an image. Sums of residuals over patches give the
# design effect. Chosen.
PATCHES_PER_IMAGE = 4

# Least inverse distance of a point, in the inverse unit of the path. Chosen.
MIN_INVERSE_DEPTH = 1e-6

# Prior 1-sigma of the inverse distance of a new point, over the median inverse distance. Chosen.
NEW_DEPTH_SIGMA = 2.0

# Information added to every inverse distance before elimination, times the square of the median
# inverse distance. Chosen.
DEPTH_DAMPING = 1e-3

# Largest relative 1-sigma of the inverse distance of a reliable point. Chosen.
RELIABLE_DEPTH_SIGMA = 0.25

# Largest 1-sigma of the inverse distance of a reliable far point, over the median inverse distance.
# Chosen.
FAR_DEPTH_SIGMA = 0.1

# Largest ratio of an inverse distance after a step to the inverse distance before the step, or to
# the median inverse distance if this is larger. Chosen.
MAX_DEPTH_STEP_RATIO = 10.0

# --- Window

# Relative 1-sigma of the baseline that fixes the gauge of the scale. Chosen.
SCALE_GAUGE_SIGMA = 1e-4

# 1-sigma of the first pose, the gauge of poses, in rad and in the unit of the path. Chosen.
POSE_GAUGE_SIGMA = 1e-6

# Relative Levenberg-Marquardt damping of the first step of a solution. Chosen.
FIRST_DAMPING = 1e-6

# Factor on the damping after a step that increases the cost. Chosen.
DAMPING_FACTOR = 100.0

# Largest number of tries of a step, with increasing damping. Chosen.
MAX_TRIES = 3

# Bounds of the factor on the variances of residuals. Chosen.
VARIANCE_FACTOR_BOUNDS = (0.1, 100.0)

# Least number of residuals for an update of the variance factor. Chosen.
MIN_RESIDUALS = 50

# Bounds of the design effect. Chosen.
DESIGN_EFFECT_BOUNDS = (1.0, 50.0)

# Initial design effect. Measured: recordings have 1 to 4; the command is not recorded.
FIRST_DESIGN_EFFECT = 1.5

# Factor on the design effect for spurious information from linearising at noisy estimates: ratio of
# squared errors to variances of lens, shutter and path, for tracks with independent errors.
# Measured: `farpoint bench --tables lens`.
LINEARISATION_EFFECT = 2.0

# Weight of the previous value in the exponential smoothing of variance factor and design effect,
# from solution to solution. Chosen.
SMOOTHING = 0.8

# --- Kernels

# Information of an unknown that no observation constrains, in place of zero, whose inverse would
# overflow. Derived: a standard deviation of 1e12 rad or units.
LEAST_INFORMATION = 1e-24

# Relative ridge on the information of a frame's pose, for components that no point constrains.
# Chosen.
WINDOW_RIDGE = 1e-9

# Value in place of the residual, px, of a point that is not in front of the camera. Convention.
UNSEEN_PX = 1e9

# Cost, in log likelihood, of a point behind the camera. Chosen: as a residual of many sigma.
UNSEEN_COST = 50.0

# Least cosine of the angle between the ray to a point and the ray at which the lens is linearised.
# Below, the point counts as not in front of the camera. Chosen.
MIN_FACING_COSINE = 0.2
