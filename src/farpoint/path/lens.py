"""Estimates of lens and shutter along the path, and the linearisation point of the lens."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry.vectors import products
from farpoint.path.constants import (
    EXACT_READOUT_SIGMA_S,
    FARTHEST_PIXEL,
    LENS_GRID,
    STALE_LENS_PX,
    UNKNOWN_READOUT_SIGMA,
)
from farpoint.path.kernels.projection import by_sigmas
from farpoint.path.options import LensRefinementOptions

__all__ = ["LensEstimate", "LensReport", "given_lens", "readout_prior", "with_prior"]


@dataclass(frozen=True, kw_only=True, eq=False)
class LensReport:
    """Estimates of lens and shutter.

    Attributes
    ----------
    camera : Camera
        Estimated camera with the covariance of its parameters.
    given : Camera
        The given camera.
    sigma : dict of str to float
        1-sigma of each parameter of the camera model, in the unit of the parameter.
    readout_s, readout_sigma_s : float
        Read-out time of a frame, first row to last, and 1-sigma of the read-out time, s.
    moved_px : float
        Largest displacement of a pixel between the given and the estimated lens, px.
    refined : bool
        Whether any lens parameter was free.
    """

    camera: Camera
    given: Camera
    sigma: dict[str, float]
    readout_s: float
    readout_sigma_s: float
    moved_px: float
    refined: bool


def given_lens(camera: Camera) -> LensReport:
    """Report of a camera whose lens and shutter are not estimated."""
    return LensReport(
        camera=camera,
        given=camera,
        sigma=camera.parameter_sigmas() if camera.size is not None else {},
        readout_s=camera.readout_s or 0.0,
        readout_sigma_s=camera.readout_sigma_s or 0.0,
        moved_px=0.0,
        refined=False,
    )


def with_prior(camera: Camera, options: LensRefinementOptions) -> Camera:
    """The camera with the prior sigmas of the lens parameters.

    The sigmas are those of the calibration, or those of the options if the calibration has no
    sigmas. If the lens is not refined, the returned camera has no sigmas.
    """
    if not options.refine:
        return camera.with_uncertainty()
    if camera.uncertainty is not None:
        return camera
    return camera.with_uncertainty(
        focal=options.focal_sigma,
        center_px=options.center_sigma_px,
        distortion_px=options.distortion_sigma_px,
    )


class LensEstimate:
    """Estimated lens parameters and read-out time.

    The lens parameters are ``given + factor @ z`` with the prior ``z ~ N(0, I)``. The columns of
    ``factor`` are independent 1-sigma errors of the given parameters (`Camera.parameter_factor`).

    Parameters
    ----------
    camera : Camera
        The given camera with its size.
    options : LensRefinementOptions
    interval_s : float
        Time between two frames, s. An unknown read-out time has a prior 1-sigma of half this time.

    Attributes
    ----------
    z : ndarray, shape (r,)
        Coefficients of the r columns of ``factor``.
    readout_s : float
        Read-out time, s.
    """

    def __init__(self, camera: Camera, options: LensRefinementOptions, interval_s: float) -> None:
        self.given = camera
        prior = with_prior(camera, options)
        self._refinable = prior.refinable
        self.factor = np.ascontiguousarray(prior.parameter_factor)
        self.z = np.zeros(self.factor.shape[1])
        self._linear_z = self.z
        self._model = self._refinable
        self.readout_s, readout_sigma_s = readout_prior(camera, options, interval_s)
        self.covariance = np.diag([1.0] * len(self.z) + [readout_sigma_s**2])
        self._reach = self._reach_px()

    @property
    def size(self) -> int:
        """Number r of independent directions in which the lens parameters can change."""
        return len(self.z)

    @property
    def common(self) -> np.ndarray:
        """The unknowns (r + 1,) that all frames share: ``z`` and the read-out time."""
        return np.append(self.z, self.readout_s)

    @property
    def change(self) -> np.ndarray:
        """Change (r,) of ``z`` from the linearisation point."""
        return self.z - self._linear_z

    def moved_px(self, z: np.ndarray) -> float:
        """Largest displacement of a pixel by a change ``z``, px."""
        return float(np.max(np.linalg.norm(self._reach @ z, axis=1), initial=0.0))

    def sigma_px(self) -> float:
        """Largest 1-sigma displacement of a pixel by the uncertainty of the lens, px."""
        lens = self.covariance[: self.size, : self.size]
        variance = np.einsum("nqi,ij,nqj->n", self._reach, lens, self._reach)
        return float(np.sqrt(np.max(variance, initial=0.0)))

    @property
    def readout_sigma_s(self) -> float:
        """1-sigma of the read-out time."""
        return float(np.sqrt(self.covariance[-1, -1]))

    def step(self, change: np.ndarray) -> None:
        """Add a change (r + 1,) to ``z`` and the read-out time.

        If the change of ``z`` would move a pixel by more than 10 px, the change of ``z`` is scaled
        down to 10 px, because the linearisation of the lens is inaccurate for larger displacements.
        """
        lens = change[:-1]
        share = min(1.0, 5.0 * STALE_LENS_PX / max(self.moved_px(lens), 1e-12))
        self.z, self.readout_s = self.z + share * lens, self.readout_s + float(change[-1])

    def is_stale(self) -> bool:
        """Whether a pixel moved by more than 2 px since the linearisation of the lens."""
        return self.moved_px(self.change) > STALE_LENS_PX

    def relinearise(self) -> None:
        """Linearise at the current ``z``.

        If ``z`` gives an invalid lens, ``z`` is set to the last linearisation point instead.
        """
        try:
            self._model = self._refinable.with_parameters(self.parameters())
        except InputError:
            self.z = self._linear_z
        else:
            self._linear_z = self.z

    def parameters(self) -> np.ndarray:
        """Estimated values (P,) of the parameters of ``Camera.refinable``."""
        return np.array(list(self._refinable.parameters.values())) + self.factor @ self.z

    def rays_of(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unit rays (N, 3) of pixels, and the derivatives (N, 3, r) of the rays by ``z``."""
        rays = self._model.unproject(pixels)
        if not self.size:
            return rays, np.zeros((len(pixels), 3, 0))
        by_lens = self._by_lens(self._model.project_parameter_jacobian(rays))
        return rays, -products(self._model.unproject_jacobian(rays), by_lens)

    def pixels_of(self, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pixels (N, 2) of rays, derivatives by the rays (N, 2, 3) and by ``z`` (N, 2, r).

        A pixel is NaN if it is outside the image by more than the image's width (in u) or height
        (in v). There, the linearisation in the lens parameters is inaccurate, and the derivatives
        of a pinhole grow to infinity at 90 degrees from the optical axis.
        """
        assert self.given.size is not None
        pixels, by_ray, by_parameters = self._model.linearised(rays)
        center = 0.5 * (np.array(self.given.size) - 1.0)
        with np.errstate(invalid="ignore"):
            far = ~(np.abs(pixels - center) < FARTHEST_PIXEL * np.array(self.given.size)).all(
                axis=1
            )
        pixels[far] = np.nan
        if not self.size:
            return pixels, by_ray, np.zeros((len(rays), 2, 0))
        return pixels, by_ray, self._by_lens(by_parameters)

    def _by_lens(self, by_parameters: np.ndarray) -> np.ndarray:
        """Derivatives (N, 2, r) of pixels by ``z``, from derivatives (N, 2, P) by parameters."""
        found = np.empty((len(by_parameters), 2, self.size))
        by_sigmas(np.ascontiguousarray(by_parameters), self.factor, found)
        return found

    def found(self) -> Camera:
        """The estimated camera, without uncertainty."""
        return replace(
            self.given, model=self._refinable.with_parameters(self.parameters()), uncertainty=None
        )

    def report(self) -> LensReport:
        """Current estimates of lens and shutter."""
        lens = self.covariance[: self.size, : self.size]
        covariance = self.factor @ lens @ self.factor.T
        readout_s = max(self.readout_s, 0.0)
        readout_sigma_s = self.readout_sigma_s
        camera = self.found().with_parameter_covariance(covariance) if self.size else self.given
        return LensReport(
            camera=replace(camera, readout_s=readout_s, readout_sigma_s=readout_sigma_s),
            given=self.given,
            sigma=dict(
                zip(self._refinable.parameters, np.sqrt(np.diag(covariance)).tolist(), strict=True)
            ),
            readout_s=readout_s,
            readout_sigma_s=readout_sigma_s,
            moved_px=self.moved_px(self.z),
            refined=self.size > 0,
        )

    def _reach_px(self) -> np.ndarray:
        """Displacements (N, 2, r), px, of a grid of pixels, for a change of each ``z[i]`` by 1."""
        assert self.given.size is not None
        width, height = self.given.size
        u, v = np.meshgrid(
            np.linspace(0, width - 1, LENS_GRID[0]), np.linspace(0, height - 1, LENS_GRID[1])
        )
        rays = self._refinable.unproject(np.column_stack([u.ravel(), v.ravel()]))
        rays = rays[np.isfinite(rays).all(axis=1)]
        if not self.size or not len(rays):
            return np.zeros((1, 2, self.size))
        reach = self._refinable.project_parameter_jacobian(rays) @ self.factor
        return reach[np.isfinite(reach).all(axis=(1, 2))]


def readout_prior(
    camera: Camera, options: LensRefinementOptions, interval_s: float
) -> tuple[float, float]:
    """Prior of the read-out time: mean and 1-sigma, s."""
    if options.readout_ms is not None:
        return 1e-3 * options.readout_ms, EXACT_READOUT_SIGMA_S
    if camera.readout_s is not None:
        return camera.readout_s, camera.readout_sigma_s or EXACT_READOUT_SIGMA_S
    if not options.refine or interval_s <= 0.0:
        return 0.0, EXACT_READOUT_SIGMA_S
    return 0.0, UNKNOWN_READOUT_SIGMA * interval_s
