"""Image sequences for the benchmark: real ones with their calibration, or a rendered drive."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from farpoint.camera import Camera, Pinhole, load_camera
from farpoint.errors import InputError
from farpoint.frames import open_frames
from farpoint.synthetic.sequence import render_drive

__all__ = ["Sequence", "find_sequences", "rendered_sequence"]


@dataclass(frozen=True, kw_only=True)
class Sequence:
    """Frames to be, and the camera that took them.

    Attributes
    ----------
    name : str
        What to call it.
    camera : Camera
        A pinhole camera: the script it is compared with knows no other.
    source : Path or None
        Where the images are; None for a rendered drive.
    seed : int
        Of the rendered drive.
    """

    name: str
    camera: Camera
    source: Path | None
    seed: int = 0

    def images(self, count: int) -> list[np.ndarray]:
        """The first images, decoded; those that cannot be are left out."""
        if self.source is None:
            frames = render_drive(self.camera, frames=count, seed=self.seed)
        else:
            frames = open_frames(self.source)
        return [frame.image for frame in islice(frames, count) if frame.image is not None]


def find_sequences(places: tuple[Path, ...]) -> list[Sequence]:
    """Places, or folders in them, that hold images and the calibration of a pinhole camera."""
    sequences = []
    for place in filter(Path.is_dir, places):
        itself = _sequence(place)
        if itself is not None:
            sequences.append(itself)
            continue
        inside = map(_sequence, sorted(filter(Path.is_dir, place.iterdir())))
        sequences += [sequence for sequence in inside if sequence is not None]
    return sequences


def _sequence(folder: Path) -> Sequence | None:
    """The folder as a sequence; None where images or a calibration that fits them are missing."""
    try:
        source = open_frames(folder)
        if source.calibration_path is None:
            return None
        camera = load_camera(source.calibration_path)
    except InputError:  # most folders hold something else
        return None
    if not isinstance(camera.model, Pinhole):
        return None
    return Sequence(name=folder.name, camera=camera, source=folder)


def rendered_sequence(seed: int) -> Sequence:
    """A drive through a street seen by a camera like KITTI's."""
    camera = Camera.pinhole(1242, 375, 720.0, 720.0, 620.5, 187.0)
    return Sequence(name="rendered drive", camera=camera, source=None, seed=seed)
