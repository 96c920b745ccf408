"""Matches as the estimator sees them: pairs of rays with the noise of each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from farpoint._kernels.pairs import RayPairs
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry.sphere import normalize, tangent_basis

# Pixels are no farther out than where the next one is the same direction.
LEAST_RAD_PER_PX = 1e-12
# Noise that is smaller is rounding of the rays themselves.
MIN_VARIANCE_RAD2 = 1e-30

__all__ = ["Matches", "matches_from_points", "matches_from_rays"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Matches:
    """Pairs of rays, and where they came from.

    Attributes
    ----------
    pairs : RayPairs
        N pairs of unit rays with the noise factor of each, in `unit`.
    index : ndarray of int, shape (N,)
        Row of each match in what the user gave; matches without a ray are left out.
    total : int
        Number of matches that the user gave.
    unit : str
        What one unit of noise is: ``"px"``, or ``"noise_rad"`` where rays were given.
    """

    pairs: RayPairs
    index: np.ndarray
    total: int
    unit: str

    def __len__(self) -> int:
        return len(self.index)

    def select(self, rows: np.ndarray) -> Matches:
        """The matches of these rows (a mask or indices)."""
        pairs = RayPairs(*(array[rows] for array in self.pairs))
        return Matches(pairs=pairs, index=self.index[rows], total=self.total, unit=self.unit)

    @cached_property
    def precision(self) -> np.ndarray:
        """Inverse mean variance (N,), rad^-2, of ``b - R a`` along one direction."""
        noise0, noise1 = self.pairs.noise0, self.pairs.noise1
        variance = np.einsum("nij,nij->n", noise0, noise0) + np.einsum("nij,nij->n", noise1, noise1)
        return 2.0 / np.maximum(variance, MIN_VARIANCE_RAD2)

    @cached_property
    def spread(self) -> float:
        """Half the width, in units of the noise, that wrong matches may fill.

        That of a uniform distribution with the second moment of the later rays.
        """
        rays1 = self.pairs.rays1
        variance = np.sum(np.var(rays1, axis=0)) / 2.0
        return float(max(np.sqrt(3.0 * variance * np.mean(self.precision)), 10.0))


def matches_from_points(
    points0: np.ndarray,
    points1: np.ndarray,
    camera0: Camera,
    camera1: Camera,
    covariance0_px2: np.ndarray | None = None,
    covariance1_px2: np.ndarray | None = None,
) -> Matches:
    """Unproject pixels (N, 2) with their noise, (N, 2, 2) px^2 up to a common factor.

    An image without covariances has isotropic noise of the median variance of the other.
    """
    for name, camera in (("camera0", camera0), ("camera1", camera1)):
        if not isinstance(camera, Camera):
            raise InputError(f"expected a Camera, got {type(camera).__name__}", field=name)
    points0 = _checked("points0", points0, (2,))
    points1 = _checked("points1", points1, (2,), rows=len(points0))
    rays0, rays1 = camera0.unproject(points0), camera1.unproject(points1)
    noise0, noise1 = camera0.unproject_jacobian(rays0), camera1.unproject_jacobian(rays1)
    index = np.flatnonzero(_has_ray(noise0) & _has_ray(noise1))
    if len(index) < len(points0):
        rays0, rays1, noise0, noise1 = rays0[index], rays1[index], noise0[index], noise1[index]
    if covariance0_px2 is not None or covariance1_px2 is not None:
        factors = _noise_factors(len(points0), covariance0_px2, covariance1_px2)
        noise0, noise1 = noise0 @ factors[0][index], noise1 @ factors[1][index]
    pairs = RayPairs(rays0, rays1, np.ascontiguousarray(noise0), np.ascontiguousarray(noise1))
    return Matches(
        pairs=pairs,
        index=index,
        total=len(points0),
        unit="px",
    )


def matches_from_rays(rays0: np.ndarray, rays1: np.ndarray, noise_rad: float) -> Matches:
    """Unit rays (N, 3), normalised here, with isotropic noise of ``noise_rad`` each."""
    rays0 = _checked("rays0", rays0, (3,))
    rays1 = _checked("rays1", rays1, (3,), rows=len(rays0))
    if not (isinstance(noise_rad, int | float | np.number) and 0 < noise_rad < np.inf):
        raise InputError(f"expected positive radians, got {noise_rad!r}", field="noise_rad")
    for name, rays in (("rays0", rays0), ("rays1", rays1)):
        if len(rays) and not np.all(np.linalg.norm(rays, axis=1) > 0):
            raise InputError("expected rays of non-zero length", field=name)
    rays0, rays1 = normalize(rays0), normalize(rays1)
    sigma = max(float(noise_rad), MIN_VARIANCE_RAD2**0.5)
    noise0, noise1 = sigma * tangent_basis(rays0), sigma * tangent_basis(rays1)
    return Matches(
        pairs=RayPairs(rays0, rays1, noise0, noise1),
        index=np.arange(len(rays0)),
        total=len(rays0),
        unit="noise_rad",
    )


def _checked(
    name: str, values: np.ndarray, shape: tuple[int, ...], rows: int | None = None
) -> np.ndarray:
    """The values as finite C-ordered float64 of shape (rows, *shape), or an InputError."""
    expected = f"({'N' if rows is None else rows}, {', '.join(map(str, shape))})"
    try:
        given = np.asarray(values)
    except ValueError as error:  # rows of different lengths
        raise InputError(f"expected numbers of shape {expected}", field=name) from error
    if given.dtype.kind not in "iuf" and given.size:
        raise InputError(
            f"expected real numbers of shape {expected}, got {given.dtype}", field=name
        )
    array = np.ascontiguousarray(given, dtype=np.float64)
    if array.ndim != 1 + len(shape) or array.shape[1:] != shape or rows not in (None, len(array)):
        raise InputError(f"expected shape {expected}, got {array.shape}", field=name)
    if not np.isfinite(array).all():
        raise InputError("expected finite numbers, got NaN or infinite ones", field=name)
    return array


def _has_ray(noise: np.ndarray) -> np.ndarray:
    """Mask (N,) of pixels with a ray that a pixel's shift moves by more than rounding."""
    return np.einsum("nij,nij->n", noise, noise) > LEAST_RAD_PER_PX**2  # False for NaN


def _noise_factors(
    count: int, covariance0_px2: np.ndarray | None, covariance1_px2: np.ndarray | None
) -> list[np.ndarray]:
    """Cholesky factors (N, 2, 2) of both images' covariances over their common median variance."""
    names = ("covariance0_px2", "covariance1_px2")
    covariances = [
        None if given is None else _checked(name, given, (2, 2), rows=count)
        for name, given in zip(names, (covariance0_px2, covariance1_px2), strict=True)
    ]
    traces = [np.trace(c, axis1=1, axis2=2) for c in covariances if c is not None]
    # The median: one match said to be useless must not make the others look exact.
    typical_variance = float(np.median(traces)) / 2.0 if count else 1.0
    factors = []
    for name, covariance in zip(names, covariances, strict=True):
        if covariance is None:
            factors.append(np.broadcast_to(np.eye(2), (count, 2, 2)))
            continue
        if not np.allclose(covariance, np.swapaxes(covariance, 1, 2), rtol=1e-6):
            raise InputError("expected symmetric matrices", field=name)
        try:
            factors.append(np.linalg.cholesky(covariance / max(typical_variance, 1e-300)))
        except np.linalg.LinAlgError as error:
            raise InputError("expected positive definite matrices", field=name) from error
    return factors
