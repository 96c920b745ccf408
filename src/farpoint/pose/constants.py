"""Every number of two-view estimates that has a name: unit, meaning and origin.

Origin is "derived" (from what), "convention", "measured" (by what), or "chosen" where nothing more
is known. "Held by" names a test that fails if the number is halved or doubled, as stated. Numbers
that kernels use, too, are in `farpoint._kernels.constants`. "Rendered" means street scenes of
`farpoint.synthetic`. If a measurement names no command, none was recorded. "Tolerance" is
`RelativePoseOptions.matching_tolerance_px`.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.constants import MAX_SEARCHED, ROUNDING

# --- Rounding and limits of numbers

# Identity of a rotation. Derived.
IDENTITY = np.eye(3)

# Covariance (1, 2, 2) of all matches where none is given, for a noise sigma of 1. Convention.
ISOTROPIC = np.eye(2)[None]

# Bounds of given variances, px^2. Chosen: products of them stay finite.
VARIANCE_BOUNDS_PX2 = (1e-60, 1e60)

# Bounds of given variances, divided by the median of all given variances. Derived: in a sum of the
# median and a variance beyond a bound, rounding would remove the smaller of the two.
VARIANCE_RATIO_BOUNDS = (ROUNDING, 1.0 / ROUNDING)

# Least variance of the noise, px^2, or noise_rad^2 if the user gave rays. Derived: noise below
# 0.001 px is rounding, not information.
MIN_NOISE_VARIANCE = 1e-6

# Determinant of a symmetric 3 x 3 matrix divided by the product of the diagonal, below which
# rounding dominates. Chosen.
MIN_RELATIVE_DETERMINANT = 1e-6

# Sigma of the rounding of a mean epipole, rad; its square is added to the variances, so that the
# covariance is not singular. Chosen.
EPIPOLE_ROUNDING_RAD = 1e-8

# --- Observability

# Largest 1-sigma, rad, of an observable rotation. Chosen.
MAX_ROTATION_SIGMA = 0.2

# Largest 1-sigma, rad, of an observable direction. Chosen: 20 deg.
MAX_DIRECTION_SIGMA = math.radians(20.0)

# Largest 1-sigma, rad, of a mean epipole. Chosen.
MAX_EPIPOLE_SIGMA = 0.5

# 1-sigma of a direction, rad. Up to this sigma the information of the matches is taken as the same
# at all poses within the covariance; above this sigma the covariance is averaged over nearby poses,
# and a secondary mode is searched for. Chosen: 2.5 deg.
LINEAR_DIRECTION_SIGMA = math.radians(2.5)

# Largest share of noise in the shrunk flow, along any axis, with which a direction is observable.
# Chosen: if all points are far, the share is larger, and 50 % of the estimated directions are
# wrong.
MAX_FLOW_NOISE_SHARE = 0.55

# 1-sigma error of the rotation of a general motion whose direction is not observable, as a share of
# the angle between this rotation and the pure rotation. Derived: below the threshold of an
# observable direction, noise explains about half of the flow.
UNOBSERVABLE_NOISE_SHARE = 0.5

# Noise sigma of a general motion divided by that of the pure rotation. Below this ratio, the
# covariance of the pure rotation is computed as if the evidence for the general motion were 1.
# Chosen.
FAR_LESS_NOISE_RATIO = 0.5

# Factor on the p-value of the F test. The search maximises the flow along the epipolar lines over
# direction and rotation, as if the largest F of this many independent tests were taken. Measured by
# simulation with 20 to 500 matches.
INDEPENDENT_TESTS = 300

# --- Searches

# Upper bound of the samples of the search for the rotation of the far points. Chosen: enough if
# half of the matches are far.
SEARCH_SAMPLES = 300

# Samples of the search for a direction with a given rotation. Chosen.
DIRECTION_SAMPLES = 200

# Samples of the search for another candidate: pairs of matches that fix a direction, and samples of
# a search with bounded noise. Derived: if 1/4 of the rejected matches flow towards one direction,
# 100 pairs miss this direction with a probability of (1 - 1/16)^100 = 0.002. Held by
# tests/pose/test_candidates.py (if halved).
CANDIDATE_SAMPLES = 100

# Least number of matches in which a candidate direction is searched for. Chosen: two of them fix
# the direction, the others test it.
MIN_REJECTED = 6

# Largest distance from the epipolar line at which a rejected match supports a direction, divided by
# the tolerance. Chosen: larger than 1, because the rotation of the far matches may differ from the
# true rotation.
REJECTED_TOLERANCE_RATIO = 2.0

# A direction on which rejected matches agree is a candidate if the expected number of directions on
# which as many outliers agree by chance is below this number. Convention: one false alarm.
CHANCE_DIRECTIONS = 1.0

# 1-sigma noise of a fit, divided by the tolerance, from which on two kinds of candidates are tried:
# those of a search with bounded noise, and those from far points. Chosen. Held by
# tests/pose/test_candidates.py (if doubled).
LARGE_NOISE_RATIO = 0.4

# --- Two motions that compete

# Log-likelihood ratio of two motions by a part of the matches, below which the ratio is computed
# again with more matches. Chosen.
UNDECIDED_LOG_RATIO = 20.0

# Upper bound of the number of matches with which a log-likelihood ratio below `UNDECIDED_LOG_RATIO`
# is computed again. Chosen.
UNDECIDED_MATCHES = 4 * MAX_SEARCHED

# Cosine of the angle between the directions of two motions, above which the motions count as one
# motion with a larger covariance. Chosen: 10 deg. Held by tests/pose/test_planar_scenes.py (if
# doubled).
COS_NEARBY = math.cos(math.radians(10.0))

# Effective sample size of the parallax prior, divided by the square root of the number of matches.
# Chosen: matches on one surface have correlated parallaxes. Held by tests/pose/test_posterior.py
# (if doubled).
EFFECTIVE_PER_ROOT = 5.0

# Tempering exponent of the likelihood ratio of two motions. The two motions have different epipolar
# lines, so their residuals contain different parts of the noise. Measured on simulated scenes: a
# secondary mode with a log-likelihood ratio of 5 to 7 is the true one in 3 of 100 cases; without
# tempering, the expected number is 1 of 400. Held by tests/pose/test_posterior.py (if doubled).
LOG_RATIO_TEMPERING = 0.5

# Tempering exponent of the likelihood ratio of the two motions of a plane, for the covariance that
# covers both motions and all motions between them. Chosen. Held by tests/pose/test_planar_scenes.py
# (if doubled).
PLANE_TEMPERING = 0.3

# Difference of the log evidences of the two motions of a plane, divided by the square root of the
# number of matches, beyond which the difference is not by chance. Derived: the 95 % interval of a
# normal distribution.
CHANCE_SIGMA = 2.0

# Share of the covariance for a second possible motion that is along the difference of the two
# motions. Chosen. Held by tests/pose/test_posterior.py (if doubled).
ALONG_DIFFERENCE_SHARE = 0.9

# --- Noise and covariance

# Parameters of a rotation. Derived.
ROTATION_PARAMETERS = 3

# Misspecification factor of given covariances, and of noise with correlated residuals. Chosen: the
# ratio of the sigmas of a match in two directions is known to a factor of 2, the ratio of the
# variances to a factor of 4. For example, the covariance of a tracker lacks errors along the motion
# of the track, which double the variance on rendered images without translation.
MISSPECIFIED_FACTOR = 4.0

# Candidates for the noise floor: variances divided by the median of the given variances. Chosen.
NOISE_FLOORS = np.array([0.0, 0.03, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 13.0, 50.0])

# Standard deviation of a normal distribution divided by its median absolute deviation. Derived.
MAD_TO_SIGMA = 1.4826

# Upper bound of the number of inliers whose neighbour is searched for. Chosen.
MAX_NEIGHBOUR_QUERIES = 400

# Least number of inliers for a correlation of residuals. Chosen.
MIN_CORRELATED_MATCHES = 50

# Limit of the correlation of neighbouring residuals times the square root of their number. For
# independent noise this product has a standard deviation of 1.1. Derived: 1 % of cases exceed the
# limit.
CORRELATED_Z = 2.5

# Factor on the design effect for errors that are correlated over more than 1/4 of the image's width
# and height, the size of the parts of the image that the design effect compares. Measured on
# rendered streets with OpenCV's Lucas-Kanade tracker. Held by
# tests/pose/test_correlated_residuals.py (if halved).
SMOOTH_ERROR_FACTOR = 1.5

# Degrees of freedom of a design effect, which is estimated from few parts of the image. Measured by
# the scatter of the design effect on rendered streets; the command is not recorded.
DESIGN_EFFECT_FREEDOM = 12.0

# Number of times that the image is divided in two to get the parts that are dealt to halves: 16
# parts. Measured on handheld recordings, where errors are smooth: with 64 parts the ratio is half
# as large, with patches of 3 to 6 matches a third. With 8 parts it is 25 % larger, but has a larger
# scatter. Held by tests/pose/test_halves_of_tracks.py (if doubled).
PART_SPLITS = 4

# Weight, in degrees of freedom, of the expected split-half ratio in the mean of the expected and
# the measured ratio. Chosen. Held by tests/pose/test_halves_of_tracks.py (if doubled).
EXPECTED_RATIO_FREEDOM = 40.0

# Least number of matches for a split-half ratio. Measured: with 24 to 48 matches of independent
# noise the ratio is 0.65 to 0.9, below `INDEPENDENT_SPLIT_RATIO`. Held by
# tests/pose/test_halves_of_tracks.py (if doubled).
MIN_SPLIT_MATCHES = 60

# Split-half ratio of matches with independent noise. Measured: 0.90 for simulated matches, 0.96 to
# 1.21 for tracks of rendered drives. Held by tests/pose/test_halves_of_tracks.py (if doubled).
INDEPENDENT_SPLIT_RATIO = 0.95

# Upper bound of the split-half ratio of a pair of views, divided by the mean ratio of earlier
# pairs, when the ratio enters the mean. Chosen: if the two halves were refined to two different
# modes, their ratio does not measure the errors of the tracks.
MAX_RATIO_OVER_MEAN = 3.0

# Weight of the initial means of `TrackErrors`, in pairs. Chosen.
FIRST_PAIRS = 1

# Largest weight of the means of `TrackErrors`, in pairs. From this weight on, the means are
# exponential moving averages. Chosen.
MAX_PAIRS = 100

# Largest correlation of neighbouring residuals of uncompressed video. Measured by `farpoint bench
# --tables codecs`: 0.12 to 0.15 for rendered drives; 0.15 to 0.2 for recordings of vehicles.
UNCOMPRESSED_CORRELATION = 0.17

# Largest correlation of neighbouring residuals that a codec causes. Measured by `farpoint bench
# --tables codecs`: HEVC at crf 28.
CODEC_CORRELATION = 0.46

# --- Errors of lens and shutter

# Upper bound of the number of inliers, evenly spaced among all, from which the derivative of the
# motion by the lens is computed. Chosen: a subset suffices, because the derivative is a ratio of
# two sums over the same matches.
LENS_INLIERS = 200

# Remaining error of the correction of rolling-shutter rows, in sigma of the rotation, at which the
# fixed-point iteration of rotation and correction ends. Chosen.
ROWS_CONVERGED_SIGMA = 0.1

# --- Independently moving object

# Share of the near matches that lie in the region of an object, a disc around the median ray of the
# near matches. Chosen.
OBJECT_REGION_SHARE = 0.9

# Share of all inliers that lie in the region of an object, below which the region is compact.
# Measured: on recorded drives and walks 0.5 and more, for objects with 0.2 of the matches 0.24.
COMPACT_REGION_SHARE = 0.3

# Least share of near matches among the inliers in the region of an object. In the region of an
# object, far points are visible only at the edges of the object. Measured: 0.66 to 1 for simulated
# objects with 0.1 and 0.2 of the matches.
NEAR_IN_REGION_SHARE = 0.6

# Least number of near matches of an object. Chosen: any two matches agree on a direction, and
# outliers may agree with it.
MIN_OBJECT_NEAR = 4

# --- Stationary matches, and a second motion

# Least share of stationary matches among all matches; with fewer, stationary matches are taken as
# ordinary outliers. Chosen.
MIN_STATIONARY_SHARE = 0.05

# Largest share of stationary matches among all matches; with more, the camera itself is taken as
# stationary. Convention: the majority.
MAX_STATIONARY_SHARE = 0.5

# Correlation of neighbouring residuals above which the reason of a result mentions the correlation.
# Chosen.
NOTED_CORRELATION = 0.6

# 1-sigma noise divided by the tolerance, below which a correlation of neighbouring residuals is
# taken as caused by the tracker alone, and not by two motions. Chosen.
MERGED_MODE_NOISE_RATIO = 0.1

# Lower bound of the share of the residual variance that is independent between neighbours. Chosen:
# residuals of two matches of one point have no independent share.
MIN_INDEPENDENT_SHARE = 0.05

# Upper bound of the noise variance in the search for one of two motions, divided by the residual
# variance that is independent between neighbours. Chosen.
SEARCH_NOISE_BOUND = 0.2

# Least log-likelihood ratio of two motions to one, divided by the design effect. Measured: 2 to 30
# for objects with 0.2 to 0.4 of the matches (bench --tables scenes movers), up to 2.5 for a driving
# camera with a rolling shutter. Held by tests/pose/test_two_motions.py (if doubled).
TWO_MOTIONS_MARGIN = 3.0

# Of two motions, the motion of the camera must have more matches than this share of the inliers of
# the single motion. Chosen.
DOMINANT_SHARE = 1.0 / 3.0

# Least number of matches that follow the first of two motions, and of all other matches. Chosen.
MIN_PART_MATCHES = 20
