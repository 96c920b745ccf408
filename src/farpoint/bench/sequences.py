"""Image sequences for the benchmark: recordings with a calibration, or a rendered drive."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from farpoint.camera import Camera, Pinhole, load_camera
from farpoint.camera.files.extrinsics import read_body_from_cam
from farpoint.errors import InputError
from farpoint.frames import Frame, open_frames
from farpoint.metrics import poses_at_frames, poses_at_times
from farpoint.synthetic.sequence import render_drive
from farpoint.trajectory.files import Trajectory, read_trajectory, read_tum

__all__ = [
    "PosedSequence",
    "Recording",
    "Sequence",
    "find_sequences",
    "find_trajectories",
    "posed_sequence",
    "recorded",
    "rendered_sequence",
]

# Names of files with the true poses of the camera, beside its images.
_TRUTHS = ("poses.txt", "groundtruth.txt")
# Names of files with the poses of a camera that only rotates, or of a body with the camera (EuRoC).
_OTHER_TRUTHS = ("truth.tum", "groundtruth*.csv")


@dataclass(frozen=True, kw_only=True)
class Sequence:
    """Sequence of images that are not yet loaded, with the camera of the images.

    Attributes
    ----------
    name : str
        Name of the sequence.
    camera : Camera
        A pinhole camera, because the OpenCV script for comparison knows no other camera.
    source : Path or None
        Path of the images; None for a rendered drive.
    seed : int
        Seed of the rendered drive.
    """

    name: str
    camera: Camera
    source: Path | None
    seed: int = 0

    def images(self, count: int) -> list[np.ndarray]:
        """The first ``count`` images, decoded; images that cannot be decoded are left out."""
        if self.source is None:
            frames = render_drive(self.camera, frames=count, seed=self.seed)
        else:
            frames = open_frames(self.source)
        return [frame.image for frame in islice(frames, count) if frame.image is not None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """All frames of a sequence, with true poses as far as known.

    Attributes
    ----------
    camera : Camera
    frames : list of Frame
    world_from_cam : ndarray, shape (len(frames), 4, 4)
        True poses, NaN where unknown.
    """

    camera: Camera
    frames: list[Frame]
    world_from_cam: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedSequence:
    """Images of a sequence with their true poses.

    Attributes
    ----------
    camera : Camera
    images : list of ndarray of uint8, each (H, W)
    world_from_cam : ndarray, shape (len(images), 4, 4)
        True poses.
    """

    camera: Camera
    images: list[np.ndarray]
    world_from_cam: np.ndarray

    def cam1_from_cam0(self, index0: int, index1: int) -> np.ndarray:
        """True motion (4, 4) between two images of the sequence."""
        return np.linalg.inv(self.world_from_cam[index1]) @ self.world_from_cam[index0]


def posed_sequence(sequence: Sequence) -> PosedSequence | None:
    """Load the whole sequence; None if the folder has no file of true poses."""
    recording = recorded(sequence, _TRUTHS)
    if recording is None:
        return None
    frames, poses = recording.frames, recording.world_from_cam
    seen = [k for k, frame in enumerate(frames) if frame.image is not None]
    known = [k for k in seen if np.isfinite(poses[k, 0, 0])]
    images = [image for k in known if (image := frames[k].image) is not None]
    return PosedSequence(camera=recording.camera, images=images, world_from_cam=poses[known])


def recorded(
    sequence: Sequence, truths: tuple[str, ...] = (*_TRUTHS, *_OTHER_TRUTHS)
) -> Recording | None:
    """Load the whole sequence; None if the folder has no file of true poses.

    The file must have one of the names ``truths``.

    If the file has one pose per frame, poses are assigned frame by frame. Otherwise poses are
    assigned by time.
    """
    folder = sequence.source
    found = [file for name in truths for file in sorted(folder.glob(name))] if folder else []
    if folder is None or not found:
        return None
    source = open_frames(folder)
    frames = list(source)
    truth = read_trajectory(found[0])
    if truth.timestamps is None or len(truth) == len(frames):
        numbers = np.array([frame.index for frame in frames])
        poses = poses_at_frames(truth.world_from_body, numbers)
    else:
        times = np.array([frame.timestamp for frame in frames])
        poses = poses_at_times(truth.timestamps, truth.world_from_body, times)
    if found[0].suffix == ".csv" and source.calibration_path is not None:
        poses = poses @ read_body_from_cam(source.calibration_path)
    height, width = next(frame.image for frame in frames if frame.image is not None).shape
    return Recording(
        camera=sequence.camera.with_size(width, height), frames=frames, world_from_cam=poses
    )


def find_sequences(places: tuple[Path, ...]) -> list[Sequence]:
    """Folders with images and the calibration of a pinhole camera.

    Each folder is one of ``places`` or directly in one of ``places``.
    """
    sequences = []
    for place in filter(Path.is_dir, places):
        itself = _sequence(place)
        if itself is not None:
            sequences.append(itself)
            continue
        inside = map(_sequence, sorted(filter(Path.is_dir, place.iterdir())))
        sequences += [sequence for sequence in inside if sequence is not None]
    return sequences


def find_trajectories(places: tuple[Path, ...]) -> dict[str, Trajectory]:
    """Measured motions by name, from files in TUM's format or from folders without images."""
    found = {}
    for place in places:
        folders = [] if place.is_file() else [place, *filter(Path.is_dir, place.iterdir())]
        inside = (file for f in folders if _sequence(f) is None for file in f.glob("*.txt"))
        for file in sorted([place] if place.is_file() else inside):
            with suppress(InputError):  # most files are something else
                found[file.stem] = read_tum(file)
    return found


def _sequence(folder: Path) -> Sequence | None:
    """The folder as a sequence; None without images or without a pinhole calibration."""
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
    """A drive through a rendered street, with a camera like that of KITTI."""
    camera = Camera.pinhole(1242, 375, 720.0, 720.0, 620.5, 187.0)
    return Sequence(name="rendered drive", camera=camera, source=None, seed=seed)
