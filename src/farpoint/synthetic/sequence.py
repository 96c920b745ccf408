"""Image sequences of the street, rendered frame by frame, with exact truth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.frames import Frame
from farpoint.synthetic.imaging import ImagingOptions
from farpoint.synthetic.kernels.raycast import cast_rays
from farpoint.synthetic.kernels.render import render
from farpoint.synthetic.motion import SmoothMotion
from farpoint.synthetic.paths import street_drive
from farpoint.synthetic.street import build_street
from farpoint.trajectory.files import Trajectory, write_tum

__all__ = ["RenderedSequence", "RenderedView", "render_drive"]

_HIDDEN = 1e-4  # a point is hidden if a surface is nearer by more than this share of the distance
_ROW_STEPS = 5  # fixed-point iterations for the row in which a point is seen


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedView:
    """A rendered frame with the true depth.

    Attributes
    ----------
    frame : Frame
        The image with index and time stamp.
    depth : ndarray, shape (height, width)
        Distance along the ray through the centre of each pixel, m, at the middle of the exposure.
        The distance is infinite for the sky. Pixels for which the lens has no ray are NaN here and
        black in the image.
    """

    frame: Frame
    depth: np.ndarray


class RenderedSequence:
    """Images of a street along a path, through any lens: a source of frames with ground truth.

    Each frame is rendered on request and independently of the other frames. Memory therefore does
    not grow with the length of the sequence, and frame 700 does not depend on whether frames 0 to
    699 were rendered.

    Parameters
    ----------
    camera : Camera
        Any central camera whose image size is known.
    path : Trajectory
        Poses ``world_from_cam`` with time stamps, in the world of `farpoint.synthetic.street`. The
        path may come from `farpoint.synthetic.paths` or be any other path above ground.
    seed : int
        Seed of the street and the noise.
    imaging : ImagingOptions
        Noise, exposure and shutter. Between the poses of the path the camera moves along the
        splines of `SmoothMotion`.
    name : str
        Short name of the source.
    given : Camera or None
        The calibration given to users of the images, with the same image size as ``camera``. None
        for the true camera.

    Attributes
    ----------
    camera : Camera
        The true camera.
    given : Camera
        The calibration given to users.
    timestamps : ndarray, shape (N,)
        Time stamps of the frames, s.
    world_from_cam : ndarray, shape (N, 4, 4)
        True poses.
    count : int
        Number of frames, N.
    """

    def __init__(
        self,
        camera: Camera,
        path: Trajectory,
        *,
        seed: int = 0,
        imaging: ImagingOptions | None = None,
        name: str = "street",
        given: Camera | None = None,
    ):
        if camera.size is None:
            raise InputError("expected a camera of known image size", field="camera")
        if path.timestamps is None or len(path) == 0:
            raise InputError("expected at least one pose with its time", field="path")
        if not (path.world_from_body[:, 1, 3] < 0.0).all():
            raise InputError("expected positions above ground (y < 0)", field="path")
        if seed < 0:
            raise InputError(f"expected 0 or more, got {seed}", field="seed")
        if given is not None and given.size != camera.size:
            raise InputError(f"expected the size {camera.size}, got {given.size}", field="given")
        self.camera = camera
        self.given = given or camera
        self.name = name
        self.count: int | None = len(path)
        self.timestamp_source = "the rendered path"
        self.calibration_path: Path | None = None
        self.notes: tuple[str, ...] = ()
        self.timestamps = path.timestamps
        self.world_from_cam = path.world_from_body
        self._seed = seed
        self._imaging = imaging or ImagingOptions()
        self._motion = None if self._imaging.is_instant else SmoothMotion(path)
        self._rays, self._steps = _ray_tables(camera, camera.size)
        self._scene = build_street(path.world_from_body[:, :3, 3], seed)

    def __len__(self) -> int:
        return len(self.timestamps)

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order."""
        for index in range(len(self)):
            yield self.view(index).frame

    def view(self, index: int) -> RenderedView:
        """Render one frame and its depth."""
        shape = self._rays.shape[:2]
        delays = self._imaging.exposure_delays_s
        total, depth = np.zeros(shape, np.float32), np.empty(shape)
        radiance, surfaces = np.empty(shape, np.float32), np.empty(shape, np.int64)
        # The middle of the exposure is rendered last, so that ``depth`` is that of the middle.
        for delay in sorted(delays, key=abs, reverse=True):
            poses = self._poses(index, np.arange(shape[0]), delay)
            render(self._scene, poses, self._rays, self._steps, radiance, depth, surfaces)
            total += radiance
        frame = Frame(
            index=index,
            timestamp=float(self.timestamps[index]),
            image=self._expose(total / np.float32(len(delays)), depth, index),
            name=f"{index:06d}",
        )
        return RenderedView(frame=frame, depth=depth)

    def distances(self, index: int, pixels: np.ndarray) -> np.ndarray:
        """Distances (N,), m, along the rays of any pixels (N, 2) of a frame, by exact ray casting.

        A distance is measured at the time at which the row of the pixel is read. The distance is
        infinite for the sky, and NaN for a pixel without a ray.
        """
        return self._cast(self._poses(index, pixels[:, 1]), self.camera.unproject(pixels))

    def transfer(self, pixels: np.ndarray, index0: int, index1: int) -> np.ndarray:
        """Pixels in frame ``index1`` of the scene points seen at ``pixels`` (N, 2) of ``index0``.

        With a rolling shutter, every point is observed at the time at which its row is read.

        Returns
        -------
        ndarray, shape (N, 2)
            True pixels in frame ``index1``; NaN if the point is hidden or out of view.
        """
        assert self.camera.size is not None
        rays0, poses0 = self.camera.unproject(pixels), self._poses(index0, pixels[:, 1])
        distance0 = self._cast(poses0, rays0)
        pixels1 = np.full((len(pixels), 2), 0.5 * (self.camera.size[1] - 1))
        points1, poses1 = self._points_in(index1, pixels1[:, 1], rays0, poses0, distance0)
        pixels1 = self.camera.project(points1)
        for _ in range(_ROW_STEPS if self._imaging.readout_s else 0):
            points1, poses1 = self._points_in(index1, pixels1[:, 1], rays0, poses0, distance0)
            pixels1 = self.camera.project(points1)
        length = np.linalg.norm(points1, axis=1)
        seen_at = self._cast(poses1, points1 / length[:, None])
        upper = np.array(self.camera.size) - 0.5
        with np.errstate(invalid="ignore"):
            hidden = seen_at < (1.0 - _HIDDEN) * length * distance0
            inside = np.all((pixels1 > -0.5) & (pixels1 < upper), axis=1)
        return np.where((inside & ~hidden)[:, None], pixels1, np.nan)

    def cam1_from_cam0(self, index0: int, index1: int) -> np.ndarray:
        """True motion ``cam1_from_cam0`` between two frames, shape (4, 4), translation in m."""
        return np.linalg.inv(self.world_from_cam[index1]) @ self.world_from_cam[index0]

    def write_truth(self, path: str | Path) -> None:
        """Write the true poses as a TUM file."""
        truth = Trajectory(timestamps=self.timestamps, world_from_body=self.world_from_cam)
        write_tum(path, truth)

    def _poses(self, index: int, rows: np.ndarray, delay_s: float = 0.0) -> np.ndarray:
        """Poses (N, 4, 4) of the camera, ``delay_s`` after the times at which ``rows`` are read."""
        if self._motion is None:
            return np.tile(self.world_from_cam[index], (len(rows), 1, 1))
        delays = self._imaging.row_delays_s(rows, self._rays.shape[0]) + delay_s
        return self._motion.poses(self.timestamps[index] + delays)

    def _points_in(
        self,
        index: int,
        rows: np.ndarray,
        rays0: np.ndarray,
        poses0: np.ndarray,
        distance0: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Points (N, 3) in camera axes when ``rows`` of a frame are read, and the camera's poses.

        Each point is divided by its distance from camera 0, so that points of the sky are finite,
        too.
        """
        poses = self._poses(index, np.nan_to_num(rows))
        cam_from_cam0 = np.linalg.inv(poses) @ poses0
        points = np.einsum("nij,nj->ni", cam_from_cam0[:, :3, :3], rays0)
        return points + cam_from_cam0[:, :3, 3] / distance0[:, None], poses

    def _cast(self, poses: np.ndarray, rays: np.ndarray) -> np.ndarray:
        scene, distances = self._scene, np.empty(len(rays))
        directions = np.einsum("nij,nj->ni", poses[:, :3, :3], rays)
        origins = np.ascontiguousarray(poses[:, :3, 3])
        cast_rays(scene.blocks, scene.hills, origins, directions, distances)
        return distances

    def _expose(self, radiance: np.ndarray, depth: np.ndarray, index: int) -> np.ndarray:
        # The seed contains the frame index, so that the noise does not depend on earlier frames.
        rng = np.random.default_rng((self._seed, 2, index))
        phase = 2.0 * math.pi * np.random.default_rng((self._seed, 3)).random()
        swing = math.sin(0.7 * self.timestamps[index] + phase)
        exposed = radiance * np.float32(1.0 + self._imaging.exposure_swing * swing)
        exposed += rng.standard_normal(radiance.shape, np.float32) * self._imaging.noise_grey
        image = np.clip(np.rint(exposed), 0.0, 255.0).astype(np.uint8)
        image[np.isnan(depth)] = 0
        return image


def render_drive(
    camera: Camera,
    *,
    frames: int = 100,
    fps: float = 10.0,
    seed: int = 0,
    imaging: ImagingOptions | None = None,
) -> RenderedSequence:
    """Drive of a car through a street, rendered through any camera.

    Examples
    --------
    >>> camera = Camera.pinhole(64, 48, 50, 50, 31.5, 23.5)
    >>> drive = render_drive(camera, frames=2, seed=1)
    >>> [frame.image.shape for frame in drive]
    [(48, 64), (48, 64)]
    """
    path = street_drive(frames, fps, seed)
    return RenderedSequence(camera, path, seed=seed, imaging=imaging, name=f"drive-{seed}")


def _ray_tables(camera: Camera, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Rays (H, W, 3) of all pixels, and changes (H, W, 3, 2) to the next pixel right and down."""
    width, height = size
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))

    def table(right: float, down: float) -> np.ndarray:
        return camera.unproject(
            np.stack([columns.ravel() + right, rows.ravel() + down], axis=1)
        ).reshape(height, width, 3)

    steps = (table(0.5, 0.0) - table(-0.5, 0.0), table(0.0, 0.5) - table(0.0, -0.5))
    return table(0.0, 0.0), np.stack(steps, axis=-1)
