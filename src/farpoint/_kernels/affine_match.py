"""Sub-pixel matching of image windows under an affine warp and a change of brightness.

For every pixel ``w = (u, v)`` of a window, counted from its centre, the model is::

    I1(p1 + d + (I + M) w) = (1 + gain) (I0(p0 + w) - mean) + mean + offset

with the eight parameters ``theta = [d (2), M by rows (4), gain, offset]`` and a Gaussian prior on
all but ``d``. Gauss-Newton with the gradients of the first image, warped as expected, so that the
normal matrix is built once (Baker and Matthews, "Lucas-Kanade 20 Years On", IJCV 56, 2004).

Floats are float32: a window holds a few hundred 8-bit values. Sums may be reordered (``reassoc``)
so that they use vector instructions; NaN and infinity keep their meaning.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["match_windows"]

PARAMETERS = 8
_SUMS = {"reassoc", "contract"}
# Variance of Scharr's gradients over that of the residual, both of white noise sampled between
# pixels: 0.23 s^2 shrunk to 0.13 s^2, over the two images' 0.88 s^2.
_GRADIENT_NOISE = 0.15
# px: residuals are taken as independent from here on (see `_covariance`); `_block_moments` writes
# the sums out.
_BLOCK = 3


@numba.njit(cache=True)
def match_windows(
    image0,
    image1,
    points0,
    expected,
    half,
    prior,
    noise_floor,
    iterations,
    tolerance,
    points1,
    covariance,
    correlation,
    warps,
    bending,
):
    """Refine ``points1`` in place and say how certain they are.

    Parameters
    ----------
    image0, image1 : ndarray of uint8, shape (H, W)
    points0 : ndarray of float64, shape (N, 2)
        Centres of the windows in the first image, px.
    expected : ndarray of float64, shape (N, 8)
        Prior mean of the parameters, and where they begin; the displacement's is zero.
    half : int
        Windows are ``2 half + 1`` pixels wide and high.
    prior : ndarray of float32, shape (8,)
        Grey-level noise variance over prior variance of each parameter; 0 for no prior.
    iterations : int
        Gauss-Newton steps at most.
    tolerance : float
        Stop when a step moves the point by less, px.
    points1 : ndarray of float64, shape (N, 2)
        In: start. Out: the match.
    covariance : ndarray of float64, shape (N, 2, 2)
        Out: covariance of ``points1``, px^2; NaN where there is no match (window outside an
        image, no texture).
    correlation : ndarray of float64, shape (N,)
        Out: correlation of the two windows at the match, -1 to 1; 0 where there is no match.
    warps : ndarray of float64, shape (N, 2, 2)
        Out: ``I + M`` of the match.
    bending : ndarray of float64, shape (N, 2, 2, 3)
        Out: what a motion that the model leaves out does to the match, px: ``[a, b, c]`` is the
        move along axis a for each unit of ``u^2``, ``u v`` or ``v^2`` (c) along axis b.
    """
    width = 2 * half + 1
    template = np.empty(width * width, np.float32)
    jacobian = np.empty((PARAMETERS, width * width), np.float32)
    residual = np.empty(width * width, np.float32)
    patch = np.empty((width + 2, width + 2), np.float32)
    normal = np.empty((PARAMETERS, PARAMETERS))
    factor = np.empty((PARAMETERS, PARAMETERS))
    theta = np.empty(PARAMETERS)
    step = np.empty(PARAMETERS)
    influence = np.empty((2, width * width), np.float32)
    monomials = _monomials(half)
    for k in range(len(points0)):
        covariance[k] = np.nan
        correlation[k] = 0.0
        if not _sample_patch(image0, points0[k, 0], points0[k, 1], half + 1, patch):
            continue
        _linearise(patch, half, expected[k], template, jacobian)
        _normal_matrix(jacobian, normal)
        theta[:] = expected[k]
        x, y = points1[k]
        seen = True
        variance = noise_floor
        for _ in range(iterations):
            seen = _residual(image1, x, y, half, theta, template, jacobian, residual)
            if not seen:
                break
            # The prior weighs as much as the noise tells it to; the residual shows the noise.
            variance = max(_dot(residual, residual) / (width * width), noise_floor)
            seen = _cholesky(normal, prior, variance, factor)
            if not seen:
                break
            _step(factor, jacobian, residual, prior, variance, expected[k], theta, step)
            if step[0] * step[0] + step[1] * step[1] < tolerance * tolerance:
                break
        if seen and _residual(image1, x, y, half, theta, template, jacobian, residual):
            points1[k, 0] = x + theta[0]
            points1[k, 1] = y + theta[1]
            correlation[k] = _correlation(template, residual, jacobian, theta)
            warps[k, 0, 0], warps[k, 0, 1] = 1.0 + theta[2], theta[3]
            warps[k, 1, 0], warps[k, 1, 1] = theta[4], 1.0 + theta[5]
            rows = _influences(jacobian, factor, influence)
            _bending(jacobian, influence, monomials, bending[k])
            _covariance(rows, influence, residual, prior, variance, half, covariance[k])


@numba.njit(cache=True)
def _sample_patch(image, x, y, reach, patch):
    """Fill ``patch`` with the values around (x, y), bilinear; False if it leaves the image."""
    left, top = int(np.floor(x)) - reach, int(np.floor(y)) - reach
    size = 2 * reach + 1
    if left < 0 or top < 0 or left + size >= image.shape[1] or top + size >= image.shape[0]:
        return False
    a = np.float32(x - np.floor(x))
    b = np.float32(y - np.floor(y))
    one = np.float32(1.0)
    for v in range(size):
        upper, lower = image[top + v], image[top + v + 1]
        for u in range(size):
            i = np.uintp(left + u)
            above = (one - a) * upper[i] + a * upper[i + np.uintp(1)]
            below = (one - a) * lower[i] + a * lower[i + np.uintp(1)]
            patch[v, u] = (one - b) * above + b * below
    return True


@numba.njit(cache=True, fastmath=_SUMS)
def _linearise(patch, half, expected, template, jacobian):
    """Window values, and the derivative of the residual by each parameter (Scharr gradients).

    The gradients are those of the second image, as expected: ``inv(I + M).T`` times the first's.
    """
    width = 2 * half + 1
    a, b, c, d = 1.0 + expected[2], expected[3], expected[4], 1.0 + expected[5]
    scale = 1.0 / (a * d - b * c)
    xx, xy = np.float32(scale * d), np.float32(-scale * c)
    yx, yy = np.float32(-scale * b), np.float32(scale * a)
    side, middle = np.float32(3.0 / 32.0), np.float32(10.0 / 32.0)
    total = np.float32(0.0)
    i = 0
    for v in range(width):
        for u in range(width):
            dx = side * (patch[v, u + 2] - patch[v, u] + patch[v + 2, u + 2] - patch[v + 2, u])
            dx += middle * (patch[v + 1, u + 2] - patch[v + 1, u])
            dy = side * (patch[v + 2, u] - patch[v, u] + patch[v + 2, u + 2] - patch[v, u + 2])
            dy += middle * (patch[v + 2, u + 1] - patch[v, u + 1])
            dx, dy = xx * dx + xy * dy, yx * dx + yy * dy
            column, row = np.float32(u - half), np.float32(v - half)
            jacobian[0, i] = dx
            jacobian[1, i] = dy
            jacobian[2, i] = dx * column
            jacobian[3, i] = dx * row
            jacobian[4, i] = dy * column
            jacobian[5, i] = dy * row
            jacobian[7, i] = -1.0
            template[i] = patch[v + 1, u + 1]
            total += template[i]
            i += 1
    mean = total / np.float32(width * width)
    for i in range(width * width):
        jacobian[6, i] = mean - template[i]


@numba.njit(cache=True, fastmath=_SUMS)
def _dot(a, b):
    total = np.float32(0.0)
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@numba.njit(cache=True)
def _normal_matrix(jacobian, normal):
    for a in range(PARAMETERS):
        for b in range(a + 1):
            normal[a, b] = _dot(jacobian[a], jacobian[b])
            normal[b, a] = normal[a, b]


@numba.njit(cache=True)
def _cholesky(normal, prior, variance, factor):
    """Lower Cholesky factor of the normal matrix with its prior; False if it has none."""
    for a in range(PARAMETERS):
        for b in range(a + 1):
            total = normal[a, b] + (variance * prior[a] if a == b else 0.0)
            for c in range(b):
                total -= factor[a, c] * factor[b, c]
            if b < a:
                factor[a, b] = total / factor[b, b]
            elif total <= 1e-6 * normal[a, a] or not total > 0.0:  # singular within float32 sums
                return False
            else:
                factor[a, a] = np.sqrt(total)
    return True


@numba.njit(cache=True)
def _solve(factor, vector):
    """Replace ``vector`` by the solution of ``factor @ factor.T @ x = vector``."""
    for a in range(PARAMETERS):
        for b in range(a):
            vector[a] -= factor[a, b] * vector[b]
        vector[a] /= factor[a, a]
    for a in range(PARAMETERS - 1, -1, -1):
        for b in range(a + 1, PARAMETERS):
            vector[a] -= factor[b, a] * vector[b]
        vector[a] /= factor[a, a]


@numba.njit(cache=True)
def _residual(image, x, y, half, theta, template, jacobian, residual):
    """Second image, warped, minus the brightness-corrected template; False if it leaves it."""
    height, width = image.shape
    reach_x = half * (abs(1.0 + theta[2]) + abs(theta[3]))
    reach_y = half * (abs(theta[4]) + abs(1.0 + theta[5]))
    x += theta[0]
    y += theta[1]
    # Written so that a NaN is outside too.
    if not (reach_x <= x < width - 1 - reach_x and reach_y <= y < height - 1 - reach_y):
        return False
    gain, offset = np.float32(theta[6]), np.float32(theta[7])
    one = np.float32(1.0)
    contrast = jacobian[6]
    i = np.uintp(0)
    for v in range(-half, half + 1):
        row_x = x + theta[3] * v
        row_y = y + (1.0 + theta[5]) * v
        for u in range(-half, half + 1):
            px = row_x + (1.0 + theta[2]) * u
            py = row_y + theta[4] * u
            # Coordinates are not negative here, so truncation is the floor. The last column and
            # row can be met by rounding alone: stay inside.
            column, row = min(int(px), width - 2), min(int(py), height - 2)
            a, b = np.float32(px - column), np.float32(py - row)
            # Unsigned, an index is not looked at for whether it counts from the end.
            left, top = np.uintp(column), np.uintp(row)
            right, bottom = left + np.uintp(1), top + np.uintp(1)
            above = (one - a) * image[top, left] + a * image[top, right]
            below = (one - a) * image[bottom, left] + a * image[bottom, right]
            value = (one - b) * above + b * below
            residual[i] = value - template[i] + gain * contrast[i] - offset
            i += np.uintp(1)
    return True


@numba.njit(cache=True)
def _step(factor, jacobian, residual, prior, variance, expected, theta, step):
    """Take a Gauss-Newton step, ``theta -= step``, given the factor of the normal matrix."""
    for a in range(PARAMETERS):
        pull = variance * prior[a] * (theta[a] - expected[a])
        step[a] = _dot(jacobian[a], residual) + pull
    _solve(factor, step)
    for a in range(PARAMETERS):
        theta[a] -= step[a]


@numba.njit(cache=True)
def _correlation(template, residual, jacobian, theta):
    """Correlation of the template with the warped window, from the residual of the match."""
    count = len(template)
    contrast = jacobian[6]  # mean - template
    power0 = _dot(contrast, contrast)
    mean = 0.0
    for i in range(count):
        mean += residual[i]
    mean /= count
    cross = (1.0 + theta[6]) * power0 - _dot(contrast, residual)
    power1 = (1.0 + theta[6]) ** 2 * power0 - 2.0 * (1.0 + theta[6]) * _dot(contrast, residual)
    power1 += _dot(residual, residual) - count * mean * mean
    if power0 <= 0.0 or power1 <= 0.0:
        return 0.0
    return cross / np.sqrt(power0 * power1)


@numba.njit(cache=True)
def _influences(jacobian, factor, influence):
    """How far the match moves, px, for each grey level that a pixel's residual is lower.

    ``influence`` (2, count) is ``P J``, with the rows ``P`` (2, 8) of the inverse normal matrix
    that belong to the displacement; these are returned.
    """
    rows = np.zeros((2, PARAMETERS))
    for a in range(2):
        rows[a, a] = 1.0
        _solve(factor, rows[a])
        pull = influence[a]
        pull[:] = 0.0
        for b in range(PARAMETERS):
            weight, column = np.float32(rows[a, b]), jacobian[b]
            for i in range(len(pull)):
                pull[i] += weight * column[i]
    return rows


@numba.njit(cache=True)
def _monomials(half):
    """``u^2``, ``u v`` and ``v^2`` (3, count) of the window's pixels."""
    width = 2 * half + 1
    monomials = np.empty((3, width * width), np.float32)
    i = 0
    for v in range(-half, half + 1):
        for u in range(-half, half + 1):
            monomials[0, i], monomials[1, i], monomials[2, i] = u * u, u * v, v * v
            i += 1
    return monomials


@numba.njit(cache=True, fastmath=_SUMS)
def _dot3(a, b, c):
    total = np.float32(0.0)
    for i in range(len(a)):
        total += a[i] * b[i] * c[i]
    return total


@numba.njit(cache=True)
def _bending(jacobian, influence, monomials, bending):
    """What the quadratic part of a window's motion, which is not modelled, does to the match.

    A motion that is farther by ``q(w)`` at the pixel w lowers its residual by ``gradient . q``.
    """
    for a in range(2):
        for b in range(2):
            for c in range(3):
                bending[a, b, c] = _dot3(influence[a], jacobian[b], monomials[c])


@numba.njit(cache=True)
def _covariance(rows, influence, residual, prior, variance, half, covariance):
    """Sandwich covariance of the displacement: what each pixel's residual did to the answer.

    A pixel moves the match by its influence times its residual. Neighbouring residuals are not
    independent (interpolation, blur, what the affine model misses), so these are summed over every
    block of 3 x 3 pixels before they are squared: the estimate of Newey and West (1987) in two
    dimensions, with triangular weights out to a lag of 2 px. It is positive semi-definite by
    construction.
    """
    width = 2 * half + 1
    count = width * width
    moves = np.zeros((2, width + 2 * (_BLOCK - 1), width + 2 * (_BLOCK - 1)), np.float32)
    for a in range(2):
        for v in range(width):
            inner = moves[a, v + _BLOCK - 1]
            for u in range(width):
                i = v * width + u
                inner[u + _BLOCK - 1] = influence[a, i] * residual[i]
    xx, xy, yy = _block_moments(moves)
    # The fit has bent the residuals towards zero: of the count / block^2 independent blocks the
    # parameters have taken their share.
    blocks = count / _BLOCK**2
    scale = blocks / (blocks - PARAMETERS / 2.0)
    covariance[0, 0] = scale * xx
    covariance[0, 1] = scale * xy
    covariance[1, 1] = scale * yy
    # The prior pulls at M, gain and offset, and these at the displacement.
    for a in range(2):
        for b in range(a, 2):
            for c in range(PARAMETERS):
                covariance[a, b] += rows[a, c] * rows[b, c] * variance * prior[c]
    covariance[1, 0] = covariance[0, 1]
    _undo_attenuation(rows, variance * count, covariance)


@numba.njit(cache=True)
def _undo_attenuation(rows, power, covariance):
    """Allow for noise in the gradients, which makes a window seem to hold more than it does.

    With ``D`` (2, 2) the information on the displacement and ``nu`` the noise's part of it, the
    covariance is ``S C S``, ``S = inv(D - nu I) D = I + nu inv(D - nu I)``. ``nu`` stays below a
    third of the smallest eigenvalue of D, since not all of a residual is noise.
    """
    # inv(D) is the displacement's block of the inverse normal matrix.
    mean = 0.5 * (rows[0, 0] + rows[1, 1])
    largest = mean + np.hypot(0.5 * (rows[0, 0] - rows[1, 1]), rows[0, 1])
    nu = min(_GRADIENT_NOISE * power, 1.0 / (3.0 * largest))
    # S = inv(I - nu inv(D))
    a, b, c = 1.0 - nu * rows[0, 0], -nu * rows[0, 1], 1.0 - nu * rows[1, 1]
    scale = 1.0 / (a * c - b * b)
    a, b, c = scale * c, -scale * b, scale * a
    p, q, r = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    covariance[0, 0] = a * a * p + 2.0 * a * b * q + b * b * r
    covariance[0, 1] = a * b * p + (a * c + b * b) * q + b * c * r
    covariance[1, 0] = covariance[0, 1]
    covariance[1, 1] = b * b * p + 2.0 * b * c * q + c * c * r


@numba.njit(cache=True)
def _block_moments(moves):
    """Mean over the block's shifts of the second moments of block sums."""
    size = moves.shape[1]
    places = size - _BLOCK + 1
    across = np.empty((size, places), np.float32)
    sums = np.empty((2, places * places), np.float32)
    for a in range(2):
        for v in range(size):
            row = moves[a, v]
            for u in range(places):
                across[v, u] = row[u] + row[u + 1] + row[u + 2]
        for v in range(places):
            for u in range(places):
                total = across[v, u] + across[v + 1, u] + across[v + 2, u]
                sums[a, v * places + u] = total
    xx, xy, yy = _dot(sums[0], sums[0]), _dot(sums[0], sums[1]), _dot(sums[1], sums[1])
    return xx / _BLOCK**2, xy / _BLOCK**2, yy / _BLOCK**2
