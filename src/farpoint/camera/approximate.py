"""A guessed camera for images without a calibration: a pinhole with the uncertainty of the guess.

The 1-sigma errors of the guess are the `CameraUncertainty` of the camera, which enters all
covariances.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

from farpoint.camera.camera import Camera
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.uncertainty import CameraUncertainty
from farpoint.camera.values import positive
from farpoint.errors import InputError

__all__ = ["CameraGuess", "EquivalentFocalLength", "HorizontalField", "camera_for"]

CAUTION = (
    "Not calibrated: the camera is {}. Rotations may be off by 10 %, directions by "
    "several degrees towards the edges of the image. The covariances allow for a focal length "
    "wrong by 10 % and a distortion of 5 % at the corners (1 sigma). Calibrate for more."
)

FOCAL_SIGMA = 0.1
"""Relative 1-sigma of the focal length, because of crops, stabilisation and rounding."""

DISTORTION_SIGMA = 0.05
"""1-sigma of the unknown distortion at a corner, relative to the corner's distance from the
centre."""

_WIDEST_DEG = 150.0  # a pinhole does not approximate a wider lens
_FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)


class CameraGuess(Protocol):
    """Data that give a camera once the size of the images is known."""

    def camera(self, width: int, height: int) -> Camera:
        """Approximate camera for images of this size."""
        ...


@dataclass(frozen=True, kw_only=True)
class HorizontalField:
    """A horizontal field of view that a person or a data sheet states.

    Attributes
    ----------
    degrees : float
        Angle across the width of the image, up to 150.
    """

    degrees: float

    def __post_init__(self) -> None:
        if not 1.0 <= self.degrees <= _WIDEST_DEG:
            raise InputError(
                f"expected 1 to {_WIDEST_DEG:g} degrees, got {self.degrees:g}; a wider lens "
                "needs a calibration",
                field="--fov",
            )

    def camera(self, width: int, height: int) -> Camera:
        """Approximate camera for images of this size."""
        focal_px = 0.5 * width / math.tan(math.radians(self.degrees) / 2.0)
        return _pinhole(width, height, focal_px, f"a field of view of {self.degrees:g} deg")


@dataclass(frozen=True, kw_only=True)
class EquivalentFocalLength:
    """Focal length in 35 mm equivalents, which gives the same diagonal field on a 36 x 24 mm frame.

    Attributes
    ----------
    millimetres : float
        Equivalent focal length, mm.
    source : str
        Origin of the focal length.
    """

    millimetres: float
    source: str

    def __post_init__(self) -> None:
        positive("focal length", self.millimetres)

    def camera(self, width: int, height: int) -> Camera:
        """Approximate camera for images of this size."""
        focal_px = self.millimetres / _FULL_FRAME_DIAGONAL_MM * math.hypot(width, height)
        words = f"{self.millimetres:g} mm in 35 mm equivalents, from {self.source}"
        return _pinhole(width, height, focal_px, words)


def camera_for(
    camera: Camera | CameraGuess, width: int, height: int, pixel_aspect: float = 1.0
) -> tuple[Camera, tuple[str, ...]]:
    """The camera of images of this size, and notes for the user of the results.

    Parameters
    ----------
    camera : Camera or CameraGuess
        A calibration is used unchanged. A guess becomes a camera with pixels of ``pixel_aspect``.
    width, height : int
        Size of the images, px.
    pixel_aspect : float
        Width of a pixel over the height of a pixel; 1 for square pixels.

    Raises
    ------
    InputError
        If a calibration is for another size (field ``camera``).
    """
    if isinstance(camera, Camera):
        return camera.with_size(width, height), ()
    guessed = camera.camera(width, height)
    if pixel_aspect != 1.0:
        lens = guessed.model
        fy = lens.parameters["fy"] * pixel_aspect
        guessed = replace(guessed, model=lens.with_parameters({"fy": fy}))
    return guessed, (CAUTION.format(guessed.source),)


def _pinhole(width: int, height: int, focal_px: float, words: str) -> Camera:
    return Camera(
        model=Pinhole(fx=focal_px, fy=focal_px, cx=0.5 * (width - 1), cy=0.5 * (height - 1)),
        size=(width, height),
        name="approximate",
        source=f"a guess: {words}, without distortion",
        uncertainty=CameraUncertainty(
            focal=FOCAL_SIGMA, distortion_px=DISTORTION_SIGMA * 0.5 * math.hypot(width, height)
        ),
    )
