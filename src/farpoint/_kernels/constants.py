"""Every number of the kernels that has a name: unit, meaning and origin.

The origin is "derived" (from what), "convention", "measured" (by what), or "chosen" if no other
origin is known. Other packages import the numbers that they share with the kernels from here. A
number that only the kernels of one package use is in that package. Constants that are arguments of
kernels are NumPy integers: numba would compile a kernel again for an argument that is a literal, as
a Python integer is.

"Unit of the noise" is the unit of the noise sigma: px, or ``noise_rad`` if the user gave rays.
"""

from __future__ import annotations

import math
from itertools import accumulate

import numpy as np


def _ends(*sizes: int) -> tuple[int, ...]:
    """For each field of an array, the index after the field, from the sizes of the fields."""
    return tuple(accumulate(sizes))


# --- Mathematics

# Natural logarithm of 2. Derived.
LN2 = math.log(2.0)

# Square root of 2. Derived.
SQRT2 = math.sqrt(2.0)

# Median of the sum of two squared normal errors of unit variance. Derived.
MEDIAN_SQUARE = 2.0 * LN2

# Angle, rad, between successive directions of a Fibonacci lattice. Derived: the golden angle.
GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))

# --- Rounding and limits of numbers

# Relative rounding error (absolute for unit rays and probabilities): lower bound of divisors and
# eigenvalues. Chosen.
ROUNDING = 1e-12

# Added to the variance g of the epipolar constraint e (`epipolar`), so that the residual e /
# sqrt(g) is not 0 / 0 for a match at the epipole, which satisfies any epipolar plane (e = g = 0).
# Chosen: below any variance.
TINY = 1e-300

# Variance that stands for no information: of the rays of filler, the matches that fill up the last
# panel (`pairs`), rad^2, so that filler is consistent with any pose; of an inverse distance, in the
# squared unit of the inverse distance. Chosen.
NO_INFORMATION_VARIANCE = 1e12

# Lower bound of the mean variance of a match, rad^2: rounding of the rays. Chosen.
MIN_VARIANCE_RAD2 = 1e-30

# Lower bound of the outlier probability of a match, so that its logarithm is finite. Derived:
# rounding of 1.
MIN_OUTLIER_PROBABILITY = 1e-16

# Lower bound of the outlier probability of a match under the general motion and under the pure
# rotation, so that logarithms and odds are finite. Chosen: rounding of 1.
MIN_MODEL_PROBABILITY = 1e-15

# Lower bound of the parallax prior of a match whose parallax no other match supports. With this
# prior the match is an outlier; a prior of 0 would leave the match out of the likelihood. Chosen.
MIN_PARALLAX_PRIOR = 1e-30

# Share of the tail if the noise variance has an upper bound: no tail, but larger than 0, because
# the prior of the share contains the logarithm of the share. Chosen.
NO_TAIL_SHARE = 1e-9

# Variance of the core of the inliers, in squared units of the noise, that is so large that all
# matches have the same robust weight, as in least squares. Chosen.
UNIFORM_WEIGHTS_VARIANCE = 1e20

# Lower bound of the information on an unknown, because the inverse of zero would overflow. Derived:
# a standard deviation of 1e12 rad or units of the path.
LEAST_INFORMATION = ROUNDING * ROUNDING

# --- Statistics

# Number of standard deviations beyond which normal noise does not explain a residual or a parallax,
# and at which a Gaussian fall-off ends. Convention: 3 sigma, exceeded with a probability of 0.0027.
GATE_SIGMA = 3.0

# Degrees of freedom of Student's t distribution, whose tails are similar to the tails of the
# residuals of tracks. Convention.
STUDENT_FREEDOM = 5.0

# Number of parameters of a motion up to scale, and number of matches that fix the motion. The
# effective number of matches divided by this number is the effective number along one axis of the
# pose. Derived: rotation (3), direction (2).
POSE_PARAMETERS = 5

# Number of changes of the velocity between two views. Derived: change of the angular velocity (3),
# turn of the direction of translation (3).
VELOCITY_CHANGES = 6

# Least number of matches for a motion, and for any group of matches that is tested or fitted by
# itself. Convention: five matches fix a motion, and a consensus needs a few more.
MIN_MATCHES = 8

# Expected number of inliers up to which a pose may fit by chance. Derived: the five of the sample,
# one more, and a margin of 0.5.
CHANCE_MATCHES = 6.5

# Least share that is not by chance: of inliers of a pose among the matches, of matches on a pixel
# grid, and of inliers with a parallax below the length in `parallax_noise`. Chosen.
MIN_SHARE = 0.1

# Least number of inliers from which a parameter of the noise is estimated. Chosen.
MIN_NOISE_MATCHES = 30

# --- Iterations

# Upper bound of the iterations of Newton, Gauss-Newton and EM, and of the sweeps of Jacobi's
# method, which end by convergence. Chosen.
MAX_ITERATIONS = np.int64(20)

# Upper bound of the steps of a coarse refinement: of a hypothesis, of a pose by half of the
# matches, of errors of the lens. Chosen.
COARSE_STEPS = np.int64(10)

# Upper bound of the rounds of EM, or of reweighted least squares, for a few parameters: of a plane,
# of the relief of a plane, of a noise floor, of the shares of two motions. Chosen.
EM_ROUNDS = 8

# Upper bound of alternations between two estimates that depend on each other: prior of the
# parallax and refinement, correction of rolling-shutter rows and motion. Chosen.
ALTERNATIONS = 4

# Upper bound of the repetitions of the average of the covariance over nearby poses. Chosen.
OUTER_ROUNDS = 3

# Angle, rad, up to which the second-order term of a rotation is smaller than the noise. Newton's
# method for five rays ends at a step of this length, and rays are taken as linear in a rotation up
# to this angle. Derived: the second-order term is 5e-5 rad.
LINEAR_STEP_RAD = 0.01

# Change of an error of the lens, in sigma of the error, up to which rays are linear in the error.
# Chosen.
LENS_LINEAR_SIGMA = 0.5

# Largest element of a Gauss-Newton step of the lens errors, in sigma of each error, at convergence.
# Convention.
LENS_CONVERGED_SIGMA = 0.01

# Predicted decrease of the cost, in log likelihood, at which a coarse refinement ends: the
# refinement of a hypothesis, of the two motions of a plane, and the first of the two refinements of
# a general motion. Also the change of the log likelihood at which EM of the relief of a plane ends.
# Chosen.
COARSE_TOLERANCE = 0.1

# Predicted decrease of the cost, in log likelihood, at which the second of the two refinements of a
# general motion ends. Derived: a step of 1/30 sigma.
FINE_TOLERANCE = 1e-3

# Predicted decrease of the cost, in log likelihood, at which the refinement by half of the matches
# ends. Chosen: a step far below the sigma of the pose from half of the matches.
HALF_TOLERANCE = 1e-2

# --- Vector instructions and packed matches

# Upper bound of the numbers that a vector instruction processes at once. The five matches of a
# sample fill five of these lanes, and the lines of an image window are padded to a multiple.
# Chosen.
VECTOR_LANES = 8

# Length of the array with the rays of a sample. Derived: two rays of 3 coordinates in each lane.
SAMPLE_SIZE = 6 * VECTOR_LANES

# Number of matches in a panel; must agree with the shift and the mask in `pairs.address`. Chosen.
LANES = 16

# First rows of the fields in a panel of matches: the two rays, the covariances of the rays (upper
# triangles), the mean variance of the flow. Derived from the sizes of the fields.
RAY0, RAY1, COVARIANCE0, COVARIANCE1, FLOW, _PANEL_ROWS = _ends(0, 3, 3, 6, 6, 1)

# Length of a panel of matches. Derived.
PANEL = _PANEL_ROWS * LANES

# First rows of the fields in a panel of terms (`information`): Jacobian (5); residual; derivative
# of the Jacobian by the inverse depth (5); weight of Jacobian and residual; weight of the
# derivative; robust weight; information that is lost because the mixture component of the match is
# unknown; squared weighted residual; inverse depth; variance of the inverse depth. Derived from the
# sizes of the fields.
(
    TERM_JACOBIAN,
    TERM_RESIDUAL,
    TERM_CHANGE,
    TERM_WEIGHT,
    TERM_SHARE,
    TERM_KNOWN,
    TERM_MISSING,
    TERM_SCATTER,
    TERM_DEPTH,
    TERM_DEPTH_VARIANCE,
    _TERM_ROWS,
) = (np.int64(row) for row in _ends(0, 5, 1, 5, 1, 1, 1, 1, 1, 1, 1))

# Length of a panel of terms. Derived.
TERMS = int(_TERM_ROWS) * LANES

# Zeros, from which `normal_equations.add_four`, `add_five` and `add_six` start to sum. Derived: a
# lower triangle each.
SUMS_OF_FOUR, SUMS_OF_FIVE, SUMS_OF_SIX = ((0.0,) * sum(range(rows + 1)) for rows in range(4, 7))

# Indices of the array that keeps the state of a refinement between steps: lowest cost; mean
# weighted squared residual of the inliers at that cost; Levenberg damping; over-relaxation of EM (1
# or 0); predicted decrease of the last step in log likelihood. Derived.
STATE_LOWEST, STATE_SQUARE, STATE_DAMPING, STATE_OVER_RELAXED, STATE_PREDICTED_DECREASE = range(5)

# Layout of the array that keeps the likeliest pose: rotation (9), direction, mixture, normal
# equations, cost, and the shares of `likelihood.linearize`. Derived from the sizes of the fields.
KEPT_T, KEPT_MIXTURE, KEPT_NORMAL, KEPT_COST, KEPT_SHARES, KEPT_SIZE = _ends(9, 3, 4, 36, 1, 4)

# --- Search for a motion

# Upper bound of the number of matches in the search: more take longer without improving the
# result. Chosen.
MAX_SEARCHED = 160

# Upper bound of the RANSAC samples for the rotation of the far matches. Chosen.
FAR_START_SAMPLES = np.int64(50)

# Number of matches in a sample for a rotation; these matches fit the rotation by construction.
# Chosen: one more than the two that fix a rotation.
ROTATION_SAMPLE = 3

# Factor by which the tolerance is widened if only the matches of the sample are consistent with the
# rotation of the far matches. Chosen.
TOLERANCE_WIDENING = 4.0

# Upper bound of the times that the tolerance is widened. Chosen.
TOLERANCE_WIDENINGS = 8

# Number of pairs of matches that give the initial directions of the search: the intersections of
# the two great circles. Chosen.
INITIAL_PAIRS = np.int64(16)

# Median flow after the far rotation, rad, beyond which Newton's method does not converge reliably
# from that rotation. Chosen.
LONG_FLOW_RAD = 0.05

# Upper bound of the factor on the number of samples for a long flow: a sample that does not start
# at the best pose then starts at the rotation that aligns the rays of the sample. Chosen.
MAX_RESTART_FACTOR = 2.0

# Probability that the initial pose leads to a wrong mode, without outliers and with a short flow.
# Measured on synthetic and real pairs; the command is not recorded.
START_FAILURE_RATE = 0.02

# Share of outlier-free samples that converge to the right mode if the initial pose is reliable.
# Chosen.
CONVERGENCE_RATE = 0.5

# Inlier share of the best pose, above which the inliers of the best pose are taken as inliers of
# the right pose. Chosen.
RELATED_CONSENSUS = 0.4

# Upper bound of the steps of Newton's method for five rays. Chosen.
FIVE_RAY_STEPS = 7

# Upper bound of the length of a step of Newton's method for five rays, rad. Chosen.
LONGEST_FIVE_RAY_STEP = 0.5

# Largest ratio of the truncated sum of squares (`five_rays.score_pose`) of a hypothesis to the
# lowest sum so far; a hypothesis with a larger ratio is not refined. Chosen.
MAX_SCORE_RATIO = 2.0

# Least ratio of the support of a hypothesis to the highest support so far; a hypothesis with a
# smaller ratio is not refined. The support is the largest possible minus the actual truncated sum
# of squares. Chosen.
MIN_SUPPORT_RATIO = 0.5

# --- Comparison of hypotheses and modes

# Difference of log likelihoods up to which two modes are taken as competing. Chosen.
MODE_MARGIN = 30.0

# Difference of log likelihoods up to which the two motions of a plane are taken as competing, for
# `MAX_SEARCHED` matches. The log likelihoods differ by chance, by an amount that is proportional to
# the square root of the number of matches. The limit is therefore scaled by the same square root.
# Chosen.
PLANAR_MARGIN = 100.0

# Two directions belong to different modes of the search if the cosine of the angle between them is
# below this number. Chosen: 20 deg.
COS_DIFFERENT_MODE = 0.94

# Cosine of the angle between two directions, above which both belong to the same mode in
# `competing_modes`, and above which the second motion of a plane adds to the covariance. Chosen: 30
# deg.
COS_SAME_MODE = math.cos(math.radians(30.0))

# Number of initial directions, evenly over the sphere, of the refinements in `competing_modes`.
# Chosen.
START_DIRECTIONS = 12

# The upper bound of the remaining decrease of the cost in a refinement is this factor times the
# decrease that is predicted for the next step, plus the last decrease. In EM of two motions, the
# factor is on the last decrease. Chosen.
REMAINING_GAIN_FACTOR = 4.0

# Difference in log likelihood within which two hypotheses are the same mode. Chosen.
SAME_MODE_LOG_RATIO = 2.0

# Initial share of outliers in EM. Chosen.
START_OUTLIER_SHARE = 0.2

# Initial share of the tail in EM. Chosen.
START_TAIL_SHARE = 0.1

# Initial share of repeated structure in EM. Chosen.
START_REPEATED_SHARE = 0.05

# Increase of the cost, in log likelihood, up to which a step is kept: EM with an unbiased variance
# may raise the cost a little. Chosen.
MAX_COST_INCREASE = 0.5

# --- Mixture of noise

# Components of the tail: 3 with a long tail, 2 with a short one. Convention: flags.
LONG_TAIL, SHORT_TAIL = 1.0, 0.0

# Ratio of sigma between one component of the tail and the next. Chosen: variances grow 8-fold.
TAIL_RATIO = math.sqrt(8.0)

# Mean of the Beta prior of two shares: that of the tail among inliers and that of repeated
# structure among outliers. Chosen.
PRIOR_SHARE = 0.01

# Weight of the Beta prior of the two shares, in matches. Among few matches chance alone produces
# some residuals of the tail. Chosen.
PRIOR_WEIGHT = 20.0

# The over-relaxation of EM is this factor times the share of the tail. Chosen.
OVER_RELAXATION = 3.0

# Upper bound of the over-relaxation of EM. Chosen.
MAX_OVER_RELAXATION = 0.7

# Flow away from the direction, in sigma, up to which noise explains the flow of a far point.
# Derived: exceeded by 1 of 160 far points.
CHEIRALITY_SIGMA = 2.5

# Factor w in the density factor exp(-w (s - c)^2 / 2) of a flow of s > c = `CHEIRALITY_SIGMA` away
# from the direction. Chosen: at s = 8.5 the factor equals exp(-s^2 / 2), that of normal noise.
CHEIRALITY_WEIGHT = 2.0

# Expected number of inliers with a cheirality penalty, below which the normal equations contain no
# cheirality residuals. Chosen.
MIN_PENALISED_INLIERS = 0.01

# Cheirality penalty of a match, from which on the normal equations do not contain the cheirality
# residual of the match. Chosen.
MAX_CHEIRALITY_PENALTY = 64.0

# Half-width of the outlier strip divided by the scale of the Cauchy distribution of repeated
# structure. 50 % of the distribution lies within plus or minus the scale. Chosen.
REPEATED_WIDTH_RATIO = 32.0

# Upper bound of the inlier probability of a match in the log odds of the sign of the direction
# (`evidence.label_matches`). Chosen.
MAX_SIGN_PROBABILITY = 0.99

# --- Parallax

# Longest candidate for the length in `parallax_noise`, divided by the mean parallax; each further
# candidate is half of the previous one. Chosen.
LONGEST_PARALLAX_LENGTH = 4.0

# Number of candidates for the length in `parallax_noise`. Chosen.
PARALLAX_LENGTHS = 9

# Limit of twice the log-likelihood ratio of noise that scales with parallax to constant noise.
# Derived: constant noise exceeds the limit in 1 of 2000 cases.
SCALING_NOISE_LIMIT = 11.0

# Lower bound of the absolute residual divided by sigma, where its logarithm is taken. Chosen.
MIN_LOG_RESIDUAL = 0.1

# Probability that more outliers than assumed lie on the epipolar lines of any direction by chance.
# Chosen.
PARALLAX_FALSE_ALARM = 0.05

# Least distance from the largest supported parallax to the start of the fall-off of the parallax
# prior, as a share of this parallax. Chosen.
MIN_PRIOR_TAIL = 0.1

# Sigma of the Gaussian fall-off of the parallax prior, as a share of the distance from the largest
# supported parallax to the start of the fall-off. Chosen.
PRIOR_FALL_OFF = 0.3

# Histogram of the parallax: number of bins. Chosen.
PARALLAX_BINS = 64

# Width of a bin of the parallax p in asinh(p / (3 sigma)). Chosen: beyond the noise a bin spans a
# factor of 1.5.
PARALLAX_BIN = 0.4

# Position of the first bin in asinh(p / (3 sigma)). Derived: a parallax of p = -3 sigma.
FIRST_RANK = math.asinh(-1.0)

# Pseudo-count of inliers, uniform in the parallax up to the start of the fall-off of the prior.
# Convention: Krichevsky and Trofimov, IEEE Trans. Inf. Theory 27, 1981, DOI
# 10.1109/TIT.1981.1056331.
UNIFORM_COUNT = 0.5

# --- Plane and pure rotation

# Beta prior of the share of matches off the plane, which lie anywhere on their epipolar lines:
# pseudo-count of matches off the plane. It is larger than 0, because one or two outliers lie on the
# epipolar lines of any motion by chance. Chosen.
OFF_PLANE_MATCHES = 4.0

# Beta prior of the share of matches off the plane: pseudo-count of all matches. Chosen.
OFF_PLANE_PRIOR_MATCHES = 40.0

# Weight, in matches, of the prior of the variance of the offsets from a plane across the epipolar
# lines. The prior value is the variance of the noise. Chosen.
RELIEF_PRIOR_MATCHES = 60.0

# Lower bound of the share of information that remains although outliers are unknown. Chosen.
MIN_KNOWN_SHARE = 0.1

# Candidates for the prior share of far points among the inliers of a general motion; the likelier
# candidate counts. Chosen.
FAR_SHARES = (0.5, 0.9)

# --- Information and covariance

# Distance to the epipole, in sigma of the flow, below which a match is left out of the information
# on the pose. Chosen.
EPIPOLE_DISTANCE_SIGMA = 8.0

# Upper bound of the leverage h in the factor 1 / (1 - h) on the scatter (`information`). Chosen.
MAX_LEVERAGE = 0.9

# Relative change of the variance of the inverse depths at convergence. Chosen.
DEPTH_CONVERGED = 1e-3

# Least share of the Gauss-Newton matrix that remains, along every axis of the pose, after the part
# due to noise is subtracted; with less, the covariance is computed with shrunk flow. Chosen.
MIN_SIGNAL = 0.85

# The share of `MIN_SIGNAL` at a nearby pose, or for half of the matches; with less there is no
# covariance. Chosen.
MIN_SIGNAL_NEARBY = 0.25

# Effective number of matches at which the variance of the gradient by the noise model and the
# scatter of the gradient have the same weight; few matches have an uncertain scatter. Chosen.
MODEL_VARIANCE_WEIGHT = 120.0

# Upper bound of (average - C) / C along any axis of the pose, where C is the covariance at the
# pose, and the average is that of the covariance over nearby poses. Chosen.
MAX_COVARIANCE_EXCESS = 8.0

# Growth of the variance of the direction above which the average of the covariance is repeated, as
# a factor. Chosen.
REPEAT_AVERAGE_ABOVE = 1.1

# Variance of the direction, rad^2, below which the average of the covariance is repeated: the limit
# of the second-order expansion. Chosen: (12 deg)^2.
MAX_DIRECTION_VARIANCE = math.radians(12.0) ** 2

# --- Halves of the matches

# Upper bound of the split-half ratio of one split. Chosen.
MAX_SPLIT_RATIO = 50.0

# Number of grids of rounded coordinates: 1, 1/2 and 1/4 px. Convention: pyramids of detectors.
PIXEL_GRIDS = np.int64(3)

# Lower bound of the noise sigma of a rounded coordinate, divided by the grid step: the displacement
# between two rounded places has an error of up to one step. With a smaller sigma, matches that jump
# to the next pixel would be outliers, and the matches that do not jump would make the camera appear
# static. Chosen.
GRID_SIGMA = 0.5

# --- Compilation

# Time, s, after which a compilation is announced. Chosen: loading compiled kernels takes less.
COMPILE_NOTICE_S = 2.0
