"""A calibrated camera with any lens model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from farpoint.camera.lens_prior import prior_covariance
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.uncertainty import CameraUncertainty, covariance_factor
from farpoint.camera.values import as_rows, finite, parameter_values, positive
from farpoint.errors import InputError

__all__ = ["Camera", "CameraModel"]


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A lens model with the size of its images.

    Attributes
    ----------
    model : CameraModel
        The lens.
    size : (width, height) or None
        Size in pixels. If the calibration has no size, the value is None until the first frame sets
        the size.
    name : str
        Name of the camera in its calibration file, or name of the file.
    source : str or None
        Kind and path of the calibration file; None for a camera made in code.
    uncertainty : CameraUncertainty or None
        Uncertainty of the parameters of the lens; None if the parameters are exact.
    readout_s : float or None
        Read-out time of a frame, from the first to the last row, s; 0 for a global shutter, None if
        unknown.
    readout_sigma_s : float or None
        1 sigma of `readout_s`, s; None if `readout_s` is exact or unknown.
    """

    model: CameraModel
    size: tuple[int, int] | None = None
    name: str = "camera"
    source: str | None = field(default=None, compare=False)
    uncertainty: CameraUncertainty | None = None
    readout_s: float | None = None
    readout_sigma_s: float | None = None

    @classmethod
    def pinhole(
        cls,
        width: int,
        height: int,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        distortion: Sequence[float] = (),
    ) -> Camera:
        """Pinhole camera with radial-tangential distortion ``(k1, k2, p1, p2[, k3...])``.

        Parameters
        ----------
        width, height : int
            Image size, px.
        fx, fy, cx, cy : float
            Focal lengths and principal point, px; the centre of the top-left pixel is (0, 0).
        distortion : sequence of float
            OpenCV's coefficients in OpenCV's order; empty for none.

        Examples
        --------
        >>> Camera.pinhole(640, 480, 500, 500, 319.5, 239.5).unproject([[319.5, 239.5]])
        array([[0., 0., 1.]])
        """
        model = Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(distortion))
        return cls(model=model, size=_checked_size(width, height))

    def with_size(self, width: int, height: int) -> Camera:
        """Camera for images of this size, or an InputError if this camera has another size."""
        if self.size is not None and self.size != (width, height):
            raise InputError(
                f"images are {width}x{height} but the calibration is for "
                f"{self.size[0]}x{self.size[1]}",
                field="camera",
            )
        return replace(self, size=_checked_size(width, height))

    def with_uncertainty(
        self,
        *,
        focal: float | None = None,
        center_px: float | None = None,
        distortion_px: float | None = None,
    ) -> Camera:
        """The same camera with calibration errors of these 1-sigmas; an exact camera by default.

        Parameters
        ----------
        focal : float, optional
            Relative error of the focal length.
        center_px : float, optional
            Error of each coordinate of the principal point, px.
        distortion_px : float, optional
            Error of the distortion as the displacement at the corner of the image, px.

        Raises
        ------
        InputError
            For a number that is not positive. The message names the argument.

        Examples
        --------
        >>> camera = Camera.pinhole(640, 480, 500, 500, 319.5, 239.5)
        >>> camera.with_uncertainty(center_px=2.0).parameter_sigmas()["cx"]
        2.0
        """
        terms = CameraUncertainty(focal=focal, center_px=center_px, distortion_px=distortion_px)
        return replace(self, uncertainty=None if terms == CameraUncertainty() else terms)

    def with_parameter_covariance(self, covariance: np.ndarray) -> Camera:
        """The same camera with this covariance of its parameters in place of any other uncertainty.

        Parameters
        ----------
        covariance : ndarray, shape (P, P)
            Covariance in the order and units of ``model.parameters`` or
            ``model.refinable().parameters``. Parameters without a row in the matrix, and parameters
            with variance 0, are exact.

        Raises
        ------
        InputError
            For a matrix that is no covariance of this number of parameters (field ``covariance``).
        """
        given = CameraUncertainty.of_covariance(covariance)
        padded = prior_covariance(self.model, self.size, given)
        return replace(self, uncertainty=CameraUncertainty.of_covariance(padded))

    def with_parameter_sigmas(self, sigmas: np.ndarray | Mapping[str, float]) -> Camera:
        """The same camera with a 1 sigma for each parameter, uncorrelated.

        Parameters
        ----------
        sigmas : array_like, shape (P,), or mapping
            Sigmas in the order of ``model.parameters`` or ``model.refinable().parameters``, or by
            name. Parameters with sigma 0 or without a name are exact.

        Raises
        ------
        InputError
            For a wrong number of values, an unknown name, or a negative number.
        """
        names = list(self.model.refinable().parameters)
        if not isinstance(sigmas, Mapping) and np.shape(sigmas) == (len(self.model.parameters),):
            names = list(self.model.parameters)
        given = parameter_values(dict.fromkeys(names, 0.0), sigmas, field="sigmas")
        for name, sigma in given.items():
            if sigma < 0.0:
                raise InputError(f"expected no negative sigma, got {sigma:g}", field=name)
        return self.with_parameter_covariance(np.diag(np.square(list(given.values()))))

    def parameter_covariance(self) -> np.ndarray:
        """Prior covariance (P, P) of the parameters of ``model.refinable()``, in their units.

        The covariance is zero for an exact camera. Rows and columns of exact parameters are zero.

        Raises
        ------
        InputError
            If an error of the distortion is given and ``size`` is None (field ``camera.size``).
        """
        return prior_covariance(self.model, self.size, self.uncertainty)

    @cached_property
    def refinable(self) -> CameraModel:
        """``model.refinable()``: the lens with all parameters that can have an error."""
        return self.model.refinable()

    @cached_property
    def parameter_factor(self) -> np.ndarray:
        """`covariance_factor` of `parameter_covariance`, shape (P, r); each column is a 1-sigma
        error.
        """
        return covariance_factor(self.parameter_covariance())

    def parameter_sigmas(self) -> dict[str, float]:
        """1 sigma of each parameter of ``model.refinable()`` by name: the root of the variance."""
        sigmas = np.sqrt(np.diag(self.parameter_covariance())).tolist()
        return dict(zip(self.model.refinable().parameters, sigmas, strict=True))

    def with_readout(self, readout_s: float, sigma_s: float | None = None) -> Camera:
        """The same camera with a rolling shutter of this read-out time.

        Parameters
        ----------
        readout_s : float
            Time from the first row to the last, s; 0 for a global shutter.
        sigma_s : float, optional
            1 sigma of the read-out time, s. By default the read-out time is exact.
        """
        if finite("readout_s", readout_s) < 0.0:
            raise InputError(f"expected no negative number, got {readout_s:g}", field="readout_s")
        sigma = None if sigma_s is None else positive("readout_sigma_s", sigma_s)
        return replace(self, readout_s=float(readout_s), readout_sigma_s=sigma)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of rays or points in camera axes (N, 3) of any length.

        Rows are NaN for points outside the field of the lens (such as behind a pinhole). Pixels
        outside the image rectangle are returned unchanged.
        """
        return self.model.project(as_rows(points, 3, "points"))

    def unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) in camera axes of pixels (N, 2); NaN rows where no ray exists."""
        return self.model.unproject(as_rows(pixels, 2, "pixels"))

    def unproject_jacobian(self, rays: np.ndarray) -> np.ndarray:
        """Derivative of the unit ray by the pixel, shape (N, 3, 2), rad/px, at rays (N, 3).

        The columns are perpendicular to the ray. The product of the derivative and the noise of a
        pixel is the noise of the ray. The derivative is NaN outside the field of the lens.
        """
        return self.model.unproject_jacobian(as_rows(rays, 3, "rays"))


def _checked_size(width: int, height: int) -> tuple[int, int]:
    for name, value in (("width", width), ("height", height)):
        if not (isinstance(value, int | np.integer) and value > 0):
            raise InputError(
                f"expected a positive whole number of pixels, got {value!r}", field=name
            )
    return int(width), int(height)
