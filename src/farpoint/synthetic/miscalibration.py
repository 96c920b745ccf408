"""A calibration with known errors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.options import coerce_float, coerce_int

__all__ = ["Miscalibration"]


@dataclass(frozen=True, kw_only=True)
class Miscalibration:
    """Errors of a calibration, for every lens model that has parameters.

    Attributes
    ----------
    focal_share : float
        Relative error of the focal length, or of the corresponding parameter of the lens; -0.5 to
        0.5.
    center_px : (float, float)
        Error of the principal point along x and y, px.
    distortion_px : float
        Root mean square displacement, px, of the corners of the image due to random errors of the
        distortion; 0 or more. The scale at the centre of the image does not change.
    seed : int
        Seed of the random errors of the distortion.

    Examples
    --------
    >>> true = Camera.pinhole(640, 480, 500, 500, 319.5, 239.5)
    >>> Miscalibration(focal_share=0.05).of(true).model.fx
    525.0
    """

    focal_share: float = 0.0
    center_px: tuple[float, float] = (0.0, 0.0)
    distortion_px: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        coerce_float(self, "-0.5 to 0.5", lambda share: -0.5 <= share <= 0.5, "focal_share")
        coerce_float(self, "0 or more px", lambda moved: moved >= 0, "distortion_px")
        coerce_int(self, 0, "seed")
        if np.shape(self.center_px) != (2,) or not np.isfinite(self.center_px).all():
            raise InputError(f"expected two numbers, got {self.center_px!r}", field="center_px")

    def of(self, camera: Camera) -> Camera:
        """The camera of the wrong calibration, without uncertainty, for a true ``camera``.

        Raises
        ------
        InputError
            If the lens does not have the parameters to be changed, if the wrong parameters are
            invalid, or if the size of the image is needed but unknown.
        """
        model = camera.refinable if self.distortion_px else camera.model
        roles = model.roles
        if not roles.scale:
            raise InputError(f"{model.title}: has nothing to be calibrated", field="camera")
        change = {name: self.focal_share * by_scale for name, by_scale in roles.scale.items()}
        for name, shift in zip(roles.center, self.center_px, strict=True):
            change[name] = change.get(name, 0.0) + shift
        values = np.array(
            [value + change.get(name, 0.0) for name, value in model.parameters.items()]
        )
        if self.distortion_px:
            factor = camera.with_uncertainty(distortion_px=self.distortion_px).parameter_factor
            rng = np.random.default_rng((self.seed, 14))
            values += factor @ rng.normal(size=factor.shape[1])
        return replace(camera, model=model.with_parameters(values), uncertainty=None)
