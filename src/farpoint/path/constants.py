"""Named constants of `farpoint.path`: meaning, unit and origin.

The origin is "derived" (from what), "convention", "measured" (by what), or "chosen" if no other
origin is known. Constants that are shared with kernels of the two-view estimator are in
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

# A two-view motion can replace the first motion of the path if the log likelihood of the two-view
# motion is at most this much lower. Chosen.
DECISIVE_LOG_RATIO = 2.0

# Least ratio of the inverse distance of a new point to its 1-sigma, for points that enter the
# median inverse distance of the new points. Chosen.
SIGNIFICANT_PARALLAX_SIGMA = 5.0

# --- First solutions

# Levenberg-Marquardt iterations of a solution before the first marginalisation. Chosen.
FIRST_ITERATIONS = 6

# Levenberg-Marquardt iterations of later solutions. Chosen: a new keyframe changes the others
# little.
LATER_ITERATIONS = 1

# 1-sigma of a displacement of unknown length, divided by the length that defines the scale
# (`PathBuilder._unit`). Chosen.
UNKNOWN_LENGTH_SIGMA = 2.0

# The first motion is tested (`first_motion.contradicting_motion`) as soon as the flow since the
# first keyframe exceeds this share of `PathOptions.keyframe_flow_px`. Chosen.
RELIABLE_FLOW_SHARE = 0.5

# While no direction is observable, the motion since the last keyframe is estimated again as soon as
# the flow since the keyframe has increased by this factor. Convention.
NEXT_ATTEMPT_FLOW_RATIO = 1.25

# Largest number of frame poses that wait for their keyframe to leave the window. Chosen.
MAX_PENDING_FRAMES = 150

# --- Lens and shutter

# Displacement of pixels by a change of the lens, px, beyond which the derivatives by the lens are
# computed again. Derived: the linearisation error is the square of the displacement divided by the
# focal length, about 0.01 px.
STALE_LENS_PX = 2.0

# 1-sigma of an unknown read-out time, divided by the time between frames. Chosen: a read-out takes
# at most the time between frames.
UNKNOWN_READOUT_SIGMA = 0.5

# 1-sigma of a known read-out time, s. Chosen: negligible, but above 0, because the variance is
# inverted.
EXACT_READOUT_SIGMA_S = 1e-9

# Largest distance of a predicted pixel from the image centre, in image widths (u) or heights (v): 1
# width or height outside the image (`LensEstimate.pixels_of`). Chosen.
FARTHEST_PIXEL = 1.5

# Columns and rows of the pixel grid at which the displacements by a change of the lens are
# computed. Chosen.
LENS_GRID = (9, 7)

# --- Perspective of windows

# 1-sigma error of each element of the affine warp of a matched window without a depth edge. Chosen.
WARP_SIGMA = 0.01

# Prior 1-sigma of the slope of a surface: derivative of log distance by angle, 1 / rad. Chosen.
SLOPE_SIGMA = 2.0

# Added to the diagonal of ``J^T J``, rad^2 / px^2, to keep the matrix invertible. J (3, 2) is the
# derivative of a ray by its pixel. Chosen.
MIN_TANGENT_METRIC = 1e-15

# Limit of each coordinate of the correction of a match, px. Corrections beyond are not applied.
# Chosen.
MAX_CORRECTION_PX = 0.2

# Ratio of the added 1-sigma of a match, px, to the misfit of the warp (`perspective._planes`).
# Measured on rendered streets through four lenses; the command is not recorded.
PX_PER_WARP_MISFIT = 1.2

# Upper bound of the misfit of a warp. Chosen: the correlation test has rejected windows that match
# badly.
MAX_WARP_MISFIT = 0.2

# --- Pose of a frame

# Two runs of Gauss-Newton steps. For each run: factors on the residual variances, one for each
# step, and whether the lens is linearised again before the run. The first factors are 100, for
# convergence from an initial error of 10 sigma. Chosen.
RESIDUAL_INFLATIONS = (
    (np.array([100.0, 100.0, 25.0, 9.0]), False),
    (np.array([4.0, 1.0, 1.0, 1.0]), True),
)

# --- Keyframes and points

# Reciprocal of the golden ratio: low-discrepancy sampling of tracks. Derived.
GOLDEN_SHARE = (math.sqrt(5.0) - 1.0) / 2.0

# A keyframe is marginalised before all others if the share of its points that are still in view is
# below this limit. Chosen.
MIN_SHARE_IN_VIEW = 0.05

# The newest keyframes, in this number, are never removed from the window. Chosen.
NEWEST_KEYFRAMES = 2

# Added to the distance between two keyframes, to keep 1 / distance finite. The distance is
# multiplied by the median inverse distance of the points (`selection.redundant_keyframe`). Chosen.
SAME_PLACE = 0.02

# Number of patches along the longer side of an image. The variance of the sums of residuals over
# patches gives the design effect. Chosen.
PATCHES_PER_IMAGE = 4

# Least inverse distance of a point, in the inverse unit of the path. Chosen.
MIN_INVERSE_DEPTH = 1e-6

# Prior 1-sigma of the inverse distance of a new point, divided by the median inverse distance.
# Chosen.
NEW_DEPTH_SIGMA = 2.0

# This number, divided by the square of the median inverse distance, is added to the information on
# every inverse distance before the points are eliminated. Chosen.
DEPTH_DAMPING = 1e-3

# Largest relative 1-sigma of the inverse distance of a reliable point. Chosen.
RELIABLE_DEPTH_SIGMA = 0.25

# Largest 1-sigma of the inverse distance of a reliable far point, divided by the median inverse
# distance. Chosen.
FAR_DEPTH_SIGMA = 0.1

# Upper bound of an inverse distance after a step, divided by the larger of the inverse distance
# before the step and the median inverse distance. Chosen.
MAX_DEPTH_STEP_RATIO = 10.0

# --- Window

# Relative 1-sigma with which the length of a baseline is fixed (gauge of the scale). Chosen.
SCALE_GAUGE_SIGMA = 1e-4

# 1-sigma with which the first pose is fixed (gauge of the poses), rad and units of the path.
# Chosen.
POSE_GAUGE_SIGMA = 1e-6

# Relative Levenberg-Marquardt damping of the first step of a solution. Chosen.
FIRST_DAMPING = 1e-6

# Factor by which the damping is increased after a step that increases the cost. Chosen.
DAMPING_FACTOR = 100.0

# Largest number of tries of a step, with increasing damping. Chosen.
MAX_TRIES = 3

# Bounds of the estimated factor on the variances of residuals. Chosen.
VARIANCE_FACTOR_BOUNDS = (0.1, 100.0)

# Least number of residuals for an update of the variance factor. Chosen.
MIN_RESIDUALS = 50

# Bounds of the design effect. Chosen.
DESIGN_EFFECT_BOUNDS = (1.0, 50.0)

# Initial design effect. Measured: the design effects of recordings are 1 to 4; the command is not
# recorded.
FIRST_DESIGN_EFFECT = 1.5

# Factor on the design effect, because linearisation at noisy estimates adds spurious information.
# The factor is the ratio of squared errors to variances of lens, shutter and path, for tracks with
# independent errors. Measured: `farpoint bench --tables lens`.
LINEARISATION_EFFECT = 2.0

# Weight of the previous value in the exponential smoothing of variance factor and design effect
# over successive solutions. Chosen.
SMOOTHING = 0.8

# --- Kernels

# Relative ridge on the information of a frame's pose, for components that no point constrains.
# Chosen.
WINDOW_RIDGE = 1e-9

# Value in place of the residual, px, of a point that is not in front of the camera. Convention.
UNSEEN_PX = 1e9

# Cost, in log likelihood, of an observation whose point is not in front of the camera. Chosen: that
# of a residual of many sigma.
UNSEEN_COST = 50.0

# Least cosine of the angle between the ray to a point and the ray at which the lens is linearised.
# With a smaller cosine, the point counts as not in front of the camera. Chosen.
MIN_FACING_COSINE = 0.2
