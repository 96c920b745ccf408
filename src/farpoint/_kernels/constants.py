"""Every number of the kernels that has a name: unit, meaning and origin.

The origin is "derived" (from what), "convention", "measured" (by what), or "chosen" if no other
origin is known. Packages above this one import shared numbers from here. A number that only the
kernels of one package use is in that package. A constant that is a NumPy integer is an argument of
kernels: for a literal, numba would compile these kernels again.
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

# Share of a number (or of 1 rad) that is rounding: keeps divisions and inverses finite. Chosen.
ROUNDING = 1e-12

# Prevents 0 / 0 for a match at the epipole, which satisfies any epipolar plane (e = g = 0).
# Chosen: below any variance.
TINY = 1e-300

# Variance that stands for no information: rad^2 for filler, which is consistent with any pose;
# squared unit of an inverse distance. Chosen.
NO_INFORMATION_VARIANCE = 1e12

# Lower bound of the mean variance of a match, rad^2: rounding of the rays. Chosen.
MIN_VARIANCE_RAD2 = 1e-30

# Lower bound of the outlier probability, for logarithms. Derived: rounding of 1.
MIN_OUTLIER_PROBABILITY = 1e-16

# Lower bound of the probabilities of inlier and outlier under two models. Chosen: rounding of 1.
MIN_MODEL_PROBABILITY = 1e-15

# Lower bound of the prior of a parallax: a match without support is an outlier with a finite cost.
# Chosen.
MIN_PARALLAX_PRIOR = 1e-30

# Share of the tail where the noise variance is bounded; its logarithm must exist. Chosen.
NO_TAIL_SHARE = 1e-9

# Variance, in units of the noise, with which all matches have the same weight. Chosen.
UNIFORM_WEIGHTS_VARIANCE = 1e20

# --- Statistics

# Standard deviations beyond which normal noise does not explain a value: its residual, parallax,
# or the end of a fall-off. Convention: 3 sigma, exceeded with a probability of 0.0027.
GATE_SIGMA = 3.0

# Degrees of freedom of Student's t, which has the tails of residuals of tracks. Convention.
STUDENT_FREEDOM = 5.0

# Parameters of a motion up to scale, matches that fix the motion, and effective matches per one
# that dominates a given axis of the pose. Derived: rotation (3), direction (2).
POSE_PARAMETERS = 5

# Least number of matches that are evidence of a motion, or of a part of the scene. Convention:
# five matches fix a motion, and a consensus needs a few more.
MIN_MATCHES = 8

# Number of matches that fit a pose by chance. Derived: the five of the sample, and one more.
CHANCE_MATCHES = 6.5

# Least share of the matches that is evidence: of inliers of a pose, of points on a pixel grid, of
# parallaxes below a length, of repeated structure. Chosen.
MIN_SHARE = 0.1

# Least number of inliers from which a parameter of the noise is estimated. Chosen.
MIN_NOISE_MATCHES = 30

# --- Iterations

# Upper bound of the iterations of Newton, Gauss-Newton and EM, which end by convergence. Chosen.
MAX_ITERATIONS = np.int64(20)

# Upper bound of the steps of a coarse refinement: of a hypothesis, a half, an error of the lens, a
# division into two parts. # Chosen.
COARSE_STEPS = np.int64(10)

# Rounds of EM for a few parameters: of a plane, of its relief, of a noise floor. Chosen.
EM_ROUNDS = 8

# Upper bound of alternations between two estimates that depend on each other: prior of the
# parallax and refinement, correction of the rows and motion. Chosen.
ALTERNATIONS = 4

# Upper bound of repetitions of a whole step: average of the covariance, move to a likelier mode.
# Chosen.
OUTER_ROUNDS = 3

# Length of a step or rotation, rad, whose square is within the noise: the last step of Newton's
# method for five rays, and a rotation in which a ray is linear. Derived: the second order is 5e-5.
LINEAR_STEP_RAD = 0.01

# Predicted decrease of the cost, in log likelihood, at which a coarse refinement ends: that of a
# hypothesis, of the plane and of its EM. Chosen.
COARSE_TOLERANCE = 0.1

# Predicted decrease of the cost, in log likelihood, at which the last refinement ends. Derived:
# 1/30 sigma.
FINE_TOLERANCE = 1e-3

# Predicted decrease of the cost, in log likelihood, at which the refinement of a half ends. Chosen:
# far below the noise of a half.
HALF_TOLERANCE = 1e-2

# Upper bound of the sweeps of Jacobi's method. Chosen: five are usual.
JACOBI_SWEEPS = 30

# --- Vector instructions and packed matches

# Numbers that a vector instruction processes at once, at most: lanes of the five rays of a
# sample, three of them filler; lines of a window have a multiple of it. Chosen.
VECTOR_LANES = 8

# Size of the rays of a sample. Derived: two rays of 3 coordinates.
SAMPLE_SIZE = 6 * VECTOR_LANES

# Matches of a panel, as the shift and mask of `pairs.address`. Chosen.
LANES = 16

# Rows of a panel of matches: two rays, their covariances (upper triangles), mean variance of the
# flow. Derived from their sizes.
RAY0, RAY1, COVARIANCE0, COVARIANCE1, FLOW, _PANEL_ROWS = _ends(0, 3, 3, 6, 6, 1)

# Length of a panel of matches. Derived.
PANEL = _PANEL_ROWS * LANES

# Rows of a panel of terms: Jacobian (5), residual, derivative of the Jacobian by the inverse depth
# (5); weight of Jacobian and residual, weight of that derivative, weight of the residual,
# information missing of it, square of the weighted residual; inverse depth and its variance.
# Derived from their sizes.
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

# Empty sums of products of rows of 4, 5 and 6 numbers. Derived: a triangle each.
SUMS_OF_FOUR, SUMS_OF_FIVE, SUMS_OF_SIX = ((0.0,) * sum(range(rows + 1)) for rows in range(4, 7))

# State of a refinement between steps: lowest cost, mean weighted squared residual of the inliers
# at that cost, Levenberg damping, over-relaxation of EM (1 or 0), predicted decrease of the last
# step in log likelihood. Derived: indices.
STATE_LOWEST, STATE_SQUARE, STATE_DAMPING, STATE_OVER_RELAXED, STATE_PREDICTED_DECREASE = range(5)

# Layout of the array that keeps the likeliest pose: rotation (9), direction, mixture, normal
# equations, cost, and the shares as of `likelihood.linearize`. Derived from their sizes.
KEPT_T, KEPT_MIXTURE, KEPT_NORMAL, KEPT_COST, KEPT_SHARES, KEPT_SIZE = _ends(9, 3, 4, 36, 1, 4)

# --- Search for a motion

# Upper bound of the number of matches in the search: more take longer without improving the
# result. Chosen.
MAX_SEARCHED = 160

# Samples for the far rotation of a subsample, at most. Chosen.
FAR_START_SAMPLES = np.int64(50)

# Size of a sample for a rotation, whose matches fit it by construction. Chosen: one more than fix
# it.
ROTATION_SAMPLE = 3

# Factor on the tolerance where no other match is consistent with a rotation. Chosen.
TOLERANCE_WIDENING = 4.0

# Upper bound of the times that the tolerance is widened. Chosen.
TOLERANCE_WIDENINGS = 8

# Number of pairs of matches whose intersections are the initial directions. Chosen.
INITIAL_PAIRS = np.int64(16)

# Median flow after the far rotation, rad, beyond which Newton's method does not converge reliably
# from that rotation. Chosen.
LONG_FLOW_RAD = 0.05

# Upper bound of the factor on the number of samples for a long flow: samples then start from
# rotations of their own. Chosen.
MAX_RESTART_FACTOR = 2.0

# Probability that the initial pose leads to a wrong mode, without outliers and with a short flow.
# Measured on synthetic and real pairs; the command is not recorded.
START_FAILURE_RATE = 0.02

# Share of outlier-free samples that converge to the right mode, where the initial pose is
# reliable. Chosen.
CONVERGENCE_RATE = 0.5

# Share of consistent matches above which a pose is related to the right one. Chosen.
RELATED_CONSENSUS = 0.4

# Upper bound of the steps of Newton's method for five rays. Chosen.
FIVE_RAY_STEPS = 7

# Length of the longest step of Newton's method for five rays, rad. Chosen.
LONGEST_FIVE_RAY_STEP = 0.5

# Ratio of the truncated squares of a hypothesis to the lowest so far, below which the hypothesis is
# refined. Chosen.
MAX_SCORE_RATIO = 2.0

# Ratio of the support of a hypothesis (limit minus truncated squares) to the highest so far, from
# which on the hypothesis is refined. Chosen.
MIN_SUPPORT_RATIO = 0.5

# --- Comparison of hypotheses and modes

# Margin in log likelihood within which two modes count as close. Chosen.
MODE_MARGIN = 30.0

# Margin in log likelihood between the two motions of a plane, which differ by chance, for
# `MAX_SEARCHED` matches; the margin grows with the square root of the number of matches. Chosen.
PLANAR_MARGIN = 100.0

# Cosine of the angle (20 deg) beyond which two directions are different modes. Chosen.
COS_DIFFERENT_MODE = 0.94

# Cosine of the angle between two directions, above which they are the same mode of the search
# from many directions, and one may be the other motion of a plane. Chosen: 30 deg.
COS_SAME_MODE = math.cos(math.radians(30.0))

# Number of initial directions, evenly over the sphere. Chosen.
START_DIRECTIONS = 12

# Factor on the predicted decrease in the upper bound of the remaining gain, which is the product
# plus the last decrease. Chosen.
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

# Over-relaxation of EM: factor on the share of the tail. Chosen.
OVER_RELAXATION = 3.0

# Over-relaxation of EM: upper bound. Chosen.
MAX_OVER_RELAXATION = 0.7

# Flow away from the direction, in sigma, that noise causes for a far point. Derived: exceeded by
# one of 160.
CHEIRALITY_SIGMA = 2.5

# Factor on the exponent of the density beyond `CHEIRALITY_SIGMA`. Chosen: at 8.5 sigma the density
# equals that of the noise.
CHEIRALITY_WEIGHT = 2.0

# Expected number of inliers with a cheirality penalty, below which the penalty is no residual.
# Chosen.
MIN_PENALISED_INLIERS = 0.01

# Cheirality penalty beyond which the penalty is no residual of a match. Chosen.
MAX_CHEIRALITY_PENALTY = 64.0

# Half-width of the outlier strip over the scale of the Cauchy distribution of repeated structure,
# within which half of it lies. Chosen.
REPEATED_WIDTH_RATIO = 32.0

# Upper bound of the inlier probability, for the odds of the sign. Chosen.
MAX_SIGN_PROBABILITY = 0.99

# --- Parallax

# Longest length over the mean parallax; each further length is half of the previous. Chosen.
LONGEST_PARALLAX_LENGTH = 4.0

# Number of lengths of the parallax. Chosen.
PARALLAX_LENGTHS = 9

# Limit of twice the log-likelihood ratio of noise that scales with parallax. Derived: chance
# exceeds it in 1 of 2000 cases.
SCALING_NOISE_LIMIT = 11.0

# Lower bound of the absolute residual over sigma, for its logarithm. Chosen.
MIN_LOG_RESIDUAL = 0.1

# Probability that more outliers than assumed lie on the epipolar lines of any direction by chance.
# Chosen.
PARALLAX_FALSE_ALARM = 0.05

# Least distance from the last supported parallax to the end of the prior, as a share of that
# parallax. Chosen.
MIN_PRIOR_TAIL = 0.1

# Sigma of the fall-off of the prior, as a share of the distance to its end. Chosen.
PRIOR_FALL_OFF = 0.3

# Histogram of the parallax: number of bins. Chosen.
PARALLAX_BINS = 64

# Width of a bin of the parallax, in ranks. Chosen: beyond the noise a bin spans a factor of 1.5.
PARALLAX_BIN = 0.4

# Rank of the first bin, at the end of the band. Derived.
FIRST_RANK = math.asinh(-1.0)

# Uniform pseudo-count of inliers up to the end of the prior. Convention: Krichevsky and Trofimov,
# IEEE Trans. Inf. Theory 27, 1981, DOI 10.1109/TIT.1981.1056331.
UNIFORM_COUNT = 0.5

# --- Plane and pure rotation

# Prior of the share of matches anywhere on their lines, off the plane: number of matches off it.
# An outlier or two lie on the lines of any motion. Chosen.
OFF_PLANE_MATCHES = 4.0

# Number of all matches in the prior of the share of matches off the plane. Chosen.
OFF_PLANE_PRIOR_MATCHES = 40.0

# Weight of the prior variance across the lines, in matches. Chosen.
RELIEF_PRIOR_MATCHES = 60.0

# Lower bound of the share of information that remains although outliers are unknown. Chosen.
MIN_KNOWN_SHARE = 0.1

# Prior share of far points under the motion model; the better one counts. Chosen.
FAR_SHARES = (0.5, 0.9)

# --- Information and covariance

# Distance to the epipole, in sigma of the flow, below which a match is left out. Chosen.
EPIPOLE_DISTANCE_SIGMA = 8.0

# Upper bound of the leverage in the correction of the scatter. Chosen.
MAX_LEVERAGE = 0.9

# Relative change of the variance of the inverse depths at convergence. Chosen.
DEPTH_CONVERGED = 1e-3

# Least share of signal in the measured flow, along any axis, without shrinkage. Chosen.
MIN_SIGNAL = 0.85

# Least share of signal at a pose nearby; with less the pose nearby has no covariance. Chosen.
MIN_SIGNAL_NEARBY = 0.25

# Weight of the model variance of the gradient, in effective matches, against that of the scatter,
# which is uncertain for few of them. Chosen.
MODEL_VARIANCE_WEIGHT = 120.0

# Upper bound of the relative excess of the average over the covariance at the pose. Chosen.
MAX_COVARIANCE_EXCESS = 8.0

# Growth of the variance of the direction above which the average of the covariance is repeated, as
# a factor. Chosen.
REPEAT_AVERAGE_ABOVE = 1.1

# Variance of the direction, rad^2, below which the average of the covariance is repeated: the limit
# of the second-order expansion. Chosen: (12 deg)^2.
MAX_DIRECTION_VARIANCE = math.radians(12.0) ** 2

# --- Correlated residuals and halves

# Upper bound of the number of inliers whose neighbour is searched for. Chosen.
MAX_NEIGHBOUR_QUERIES = 400

# Least number of inliers for a correlation of residuals. Chosen.
MIN_CORRELATED_MATCHES = 50

# Limit of the correlation of neighbouring residuals times the square root of their number. For
# independent noise its standard deviation is 1.1. Derived: 1 % of cases exceed the limit.
CORRELATED_Z = 2.5

# Number of times that every part of the image is split in two. Chosen.
IMAGE_SPLITS = np.int64(4)

# Number of parts of the image. Derived.
IMAGE_PARTS = 2 ** int(IMAGE_SPLITS)

# Upper bound of the split-half ratio of one split. Chosen.
MAX_SPLIT_RATIO = 50.0

# Number of grids of rounded coordinates: 1, 1/2 and 1/4 px. Convention: pyramids of detectors.
PIXEL_GRIDS = np.int64(3)

# Lower bound of the noise sigma of a rounded coordinate, over the grid step: the displacement
# between two rounded places has an error of up to one step. With less noise, matches that jump to
# the next pixel would be outliers, and all others would prove that the camera stands still.
# Chosen.
GRID_SIGMA = 0.5

# --- Compilation

# Time, s, after which a compilation is announced. Chosen: loading compiled kernels takes less.
COMPILE_NOTICE_S = 2.0
