"""Every number of two-view estimates that has a name: unit, meaning and origin.

Origin is "derived" (from what), "convention", "measured" (by what), or "chosen" where nothing more
is known. Numbers that kernels use, too, are in `farpoint._kernels.constants`. "Rendered" means
street scenes of `farpoint.synthetic`. If a measurement names no command, none was recorded.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.constants import MAX_SEARCHED, ROUNDING

# --- Rounding and limits of numbers

# Identity of a rotation. Derived.
IDENTITY = np.eye(3)

# Covariance (1, 2, 2) of all matches where none is given, in units of the noise. Convention.
ISOTROPIC = np.eye(2)[None]

# Bounds of given variances, px^2. Chosen: products of them stay finite.
VARIANCE_BOUNDS_PX2 = (1e-60, 1e60)

# Bounds of given variances over their median. Derived: rounding of a sum with the median.
VARIANCE_RATIO_BOUNDS = (ROUNDING, 1.0 / ROUNDING)

# Least variance of the noise, px^2 (or in units of given noise). Derived: noise below 0.001 px is
# rounding, not information.
MIN_NOISE_VARIANCE = 1e-6

# Determinant of a 3 x 3 matrix over the product of the diagonal, below which rounding dominates.
# Chosen.
MIN_RELATIVE_DETERMINANT = 1e-6

# Rounding of a mean epipole, rad: keeps its covariance regular. Chosen.
EPIPOLE_ROUNDING_RAD = 1e-8

# --- Observability

# Largest 1-sigma, rad, of an observable rotation. Chosen.
MAX_ROTATION_SIGMA = 0.2

# Largest 1-sigma, rad, of an observable direction. Chosen: 20 deg.
MAX_DIRECTION_SIGMA = math.radians(20.0)

# Largest 1-sigma, rad, of a mean epipole. Chosen.
MAX_EPIPOLE_SIGMA = 0.5

# 1-sigma of a direction, rad, up to which the information is the same at all poses within the
# covariance; above it a secondary mode is searched for. Chosen: 2.5 deg.
LINEAR_DIRECTION_SIGMA = math.radians(2.5)

# Largest share of noise in the shrunk flow, along any axis, with which a direction is observable.
# Chosen: where all points are far the share is larger, and half of the directions are wrong.
MAX_FLOW_NOISE_SHARE = 0.55

# Share of its distance to the pure rotation by which a rotation may be wrong, if its direction is
# not observable. Derived: noise explains about half of the flow below the threshold.
UNOBSERVABLE_NOISE_SHARE = 0.5

# Noise of a general motion over that of the pure rotation below which the general motion may be
# true whatever the evidence for it. Chosen.
FAR_LESS_NOISE_RATIO = 0.5

# Number of independent tests of the F test. Measured by simulation with 20 to 500 matches: the
# search maximises over direction and rotation, and the tail of the maximum is this many times that
# of one test.
INDEPENDENT_TESTS = 300

# --- Searches

# Samples of the search for a rotation or a dominant motion, at most. Chosen: enough where half of
# the matches are of the dominant motion.
SEARCH_SAMPLES = 300

# Samples of the search for a direction with a given rotation. Chosen.
DIRECTION_SAMPLES = 200

# Samples of the search for another candidate: pairs of rejected matches, and a search with bounded
# noise. Derived: where 1/4 of the rejected matches has a direction, 100 pairs miss it with a
# probability of (1 - 1/16)^100 = 0.002. Held by tests/pose/test_candidates.py (if halved).
CANDIDATE_SAMPLES = 100

# Least number of rejected matches that test a direction. Chosen: two of them fix it.
MIN_REJECTED = 6

# Distance of rejected matches from an epipolar line, over the tolerance. Chosen: larger than 1
# because the far rotation may not be the rotation of their motion.
REJECTED_TOLERANCE_RATIO = 2.0

# A direction is tried if outliers are expected to have fewer directions with such a consensus.
# Convention: one false alarm.
CHANCE_DIRECTIONS = 1.0

# Least noise, over the tolerance, with which candidates are searched for. Chosen. Held by
# tests/pose/test_candidates.py (if doubled).
LARGE_NOISE_RATIO = 0.4

# --- Two motions that compete

# Log-likelihood ratio of a part of the matches below which more matches are evaluated. Chosen.
UNDECIDED_LOG_RATIO = 20.0

# Number of matches that are evaluated where a part of the matches leaves a motion undecided.
# Chosen.
UNDECIDED_MATCHES = 4 * MAX_SEARCHED

# Cosine of the angle below which two motions count as one motion with a larger covariance. Chosen:
# 10 deg. Held by tests/pose/test_planar_scenes.py (if doubled).
COS_NEARBY = math.cos(math.radians(10.0))

# Effective sample size of the parallax prior over the square root of the number of matches. Chosen:
# matches on one surface are correlated. Held by tests/pose/test_posterior.py (if doubled).
EFFECTIVE_PER_ROOT = 5.0

# Tempering exponent of the likelihood ratio of two motions: each has its own epipolar lines and so
# its own part of the noise. Measured on simulated scenes: a secondary mode with a log-likelihood
# ratio of 5 to 7 is the true one in 3 of 100, not in 1 of 400. Held by
# tests/pose/test_posterior.py (if doubled).
LOG_RATIO_TEMPERING = 0.5

# Tempering exponent for the two motions of a plane and all motions between them. Chosen. Held by
# tests/pose/test_planar_scenes.py (if doubled).
PLANE_TEMPERING = 0.3

# Difference of the evidences of the two motions of a plane, over the root of the number of matches,
# beyond which it is not by chance. Derived: the 95 % interval of a normal distribution.
CHANCE_SIGMA = 2.0

# Share of the covariance between two motions along the axis on which they differ. Chosen. Held by
# tests/pose/test_posterior.py (if doubled).
ALONG_DIFFERENCE_SHARE = 0.9

# --- Noise and covariance

# Parameters of a rotation. Derived.
ROTATION_PARAMETERS = 3

# Misspecification factor of given covariances, and of noise with correlated residuals. Chosen: the
# ratio of the sigmas in two directions is known to a factor of 2; a tracker's covariance lacks its
# errors along the motion of the track (twice the variance on rendered images without translation).
MISSPECIFIED_FACTOR = 4.0

# Floors to choose from, as variances over the median of the given ones. Chosen.
NOISE_FLOORS = np.array([0.0, 0.03, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 13.0, 50.0])

# Standard deviation of a normal distribution over its median absolute deviation. Derived.
MAD_TO_SIGMA = 1.4826

# Factor for errors that are smooth over more than 1/4 of the image's width and height, which parts
# of the image cannot show. Measured on rendered streets with OpenCV's Lucas-Kanade tracker. Held by
# tests/pose/test_correlated_residuals.py (if halved).
SMOOTH_ERROR_FACTOR = 1.5

# Degrees of freedom of a design effect from few parts. Measured by its scatter on rendered
# streets; the command is not recorded.
DESIGN_EFFECT_FREEDOM = 12.0

# Least mean number of matches of a patch; the largest is twice as much. Chosen: with 6, the
# coverage on rendered sequences is the same. Held by tests/pose/test_halves_of_tracks.py (if
# halved).
PATCH_MATCHES = 3.0

# Degrees of freedom of the expected split-half ratio, beside those of the measured one. Chosen.
# Held by tests/pose/test_halves_of_tracks.py (if doubled).
EXPECTED_RATIO_FREEDOM = 40.0

# Least number of matches for splits. Measured: with 24 to 48 matches of independent noise the ratio
# is 0.65 to 0.9. Held by tests/pose/test_halves_of_tracks.py (if doubled).
MIN_SPLIT_MATCHES = 60

# Split-half ratio of matches with independent noise. Measured; the command is not recorded. Held by
# tests/pose/test_halves_of_tracks.py (if doubled).
INDEPENDENT_SPLIT_RATIO = 0.95

# Correlation of residuals in neighbouring patches above which halves underestimate the variance.
# Chosen. Held by tests/pose/test_halves_of_tracks.py (if doubled).
HALVES_CORRELATION = 0.25

# Slope of the variance factor above `HALVES_CORRELATION`. Measured: most recordings need 2; one
# with many reflections and moving objects, and simulated surfaces with a common error of 3 sigma, a
# little more than 4. Held by tests/pose/test_halves_of_tracks.py (if doubled).
HALVES_CORRELATION_SLOPE = 4.0

# Upper bound of a pair's split-half ratio in the mean, over the mean. Chosen: halves refined to
# two different modes are no measure of the tracks' errors.
MAX_RATIO_OVER_MEAN = 3.0

# Upper bound of the mean split-half ratio of uncompressed video. Measured: rendered, 0.91 to 1.07.
UNCOMPRESSED_SPLIT_RATIO = 1.08

# Largest excess of the mean split-half ratio over `UNCOMPRESSED_SPLIT_RATIO`. Measured with strong
# compression; the command is not recorded.
MAX_COMPRESSION_EXCESS = 1.0

# --- Errors of lens and shutter

# Number of inliers from which the derivative of the motion by the lens is taken, spread over all.
# Chosen: it is a ratio of two sums over the same matches.
LENS_INLIERS = 200

# Step of an error of the lens, in its sigmas, that ends Gauss-Newton. Convention.
LENS_CONVERGED_SIGMA = 0.01

# Errors of a shutter. Derived: its read-out, and the derivative of the angular velocity (3).
SHUTTER_ERRORS = 4

# Change of an error of the lens, in its sigmas, up to which rays are linear in it. Chosen.
LENS_LINEAR_SIGMA = 0.5

# Remaining error of the correction of rows, in sigma, at which its fixed point has converged.
# Chosen.
ROWS_CONVERGED_SIGMA = 0.1

# --- Independently moving object

# Share of the near matches that the region around their median ray holds. Chosen.
OBJECT_REGION_SHARE = 0.9

# Largest share of all inliers in that region. Measured: recorded drives and walks have 0.5 and
# more, objects with 0.2 of the matches 0.24.
COMPACT_REGION_SHARE = 0.3

# Least share of near matches among the inliers of the region: far points show at an object's edges
# only. Measured: simulated objects with 0.1 and 0.2 of the matches have 0.66 to 1.
NEAR_IN_REGION_SHARE = 0.6

# Least number of near matches of an object. Chosen: two fix a direction, and outliers may agree
# with it.
MIN_OBJECT_NEAR = 4

# --- Stationary matches, and a second motion

# Least share of stationary matches, else they are ordinary outliers. Chosen.
MIN_STATIONARY_SHARE = 0.05

# Largest share of stationary matches, above which the camera itself is stationary. Convention: the
# majority.
MAX_STATIONARY_SHARE = 0.5

# Residual correlation above which the reason of a result mentions it. Chosen.
NOTED_CORRELATION = 0.6

# Noise over the tolerance below which trackers alone correlate neighbouring residuals. Chosen.
MERGED_MODE_NOISE_RATIO = 0.1

# Least independent share of the variance. Chosen: two matches of one point have none.
MIN_INDEPENDENT_SHARE = 0.05

# Bound of the noise variance over the independent one, in the search. Chosen.
SEARCH_NOISE_BOUND = 0.2

# Least log-likelihood ratio of two motions to one, divided by the design effect. Measured: objects
# with 0.2 to 0.4 of the matches have 2 to 30 (bench --tables scenes movers), a driving camera with
# a rolling shutter up to 2.5. Held by tests/pose/test_two_motions.py (if doubled).
TWO_MOTIONS_MARGIN = 3.0

# Least share of the matches that the dominant motion has. Chosen.
DOMINANT_SHARE = 1.0 / 3.0

# Residual correlation from which on a part of the image may have its own motion. Chosen.
SUSPECT_CORRELATION = 0.3

# Least number of matches of a part. Chosen.
MIN_PART_MATCHES = 20
