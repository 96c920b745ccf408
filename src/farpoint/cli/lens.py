"""Options of the camera: a calibration file, or an approximate field of view."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from farpoint.camera import Camera, CameraGuess, HorizontalField, load_camera
from farpoint.errors import InputError
from farpoint.frames import find_focal_length
from farpoint.frames.bags import BagImages

__all__ = ["LensOptions"]


@dataclass(frozen=True, kw_only=True)
class LensOptions:
    """The camera.

    Attributes
    ----------
    camera : Path or None
        Calibration file, or auto to use the focal length in EXIF or in the metadata of a video.
    fov : float or None
        Approximate horizontal field of view of the image, deg, instead of a calibration.
    name : str or None
        Name of the camera, for a calibration file with several cameras.
    """

    camera: Annotated[Path | None, tyro.conf.arg(metavar="CALIB")] = None
    fov: Annotated[float | None, tyro.conf.arg(metavar="DEG")] = None
    name: str | None = None

    def known(self) -> Camera | HorizontalField | None:
        """The camera from the options; None if the source provides the camera."""
        if self.fov is not None and self.camera is not None:
            raise InputError("expected --fov or --camera, not both", field="--fov")
        if self.fov is not None:
            return HorizontalField(degrees=self.fov)
        if self.camera is None or self._is_auto:
            return None
        return load_camera(self.camera, self.name)

    def from_source(self, frames: object, source: str) -> Camera | CameraGuess:
        """The camera from the files of the source, if the source is a bag or the option is auto.

        Parameters
        ----------
        frames : object
            The opened source. Only a bag, a video file or image files can have a camera.
        source : str
            Source as given by the user.
        """
        if isinstance(frames, BagImages):
            return frames.camera()
        if self._is_auto:
            return find_focal_length(frames, source)
        problem = "missing; expected a calibration file, or auto, or --fov DEG for a rough guess"
        beside = getattr(frames, "calibration_path", None)
        if beside is not None:
            problem += f"; beside the images stands {beside}"
        raise InputError(problem, file=source, field="--camera")

    @contextmanager
    def naming_file(self) -> Iterator[None]:
        """Add the name of the calibration file to an error about a calibration that does not fit
        the images.
        """
        try:
            yield
        except InputError as error:
            if error.field != "camera":
                raise
            raise InputError(error.problem, file=self.camera, field="image size") from None

    @property
    def _is_auto(self) -> bool:
        return str(self.camera) == "auto"
