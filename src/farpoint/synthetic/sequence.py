"""Image sequences of the street, rendered frame by frame, with exact truth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from farpoint._kernels.raycast import cast_rays
from farpoint._kernels.render import render
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.frames import Frame
from farpoint.options import settle_float
from farpoint.synthetic.paths import street_drive
from farpoint.synthetic.street import build_street
from farpoint.trajectory.files import Trajectory, write_tum

__all__ = ["ImagingOptions", "RenderedSequence", "RenderedView", "render_drive"]

_HIDDEN = 1e-4  # a point is hidden when something stands nearer by this share of its distance


@dataclass(frozen=True, kw_only=True)
class ImagingOptions:
    """What the sensor adds to the picture.

    Attributes
    ----------
    noise_grey : float
        1-sigma of the normal noise on every pixel, grey levels; rounding adds 0.29.
    exposure_swing : float
        Amplitude, 0 to 0.5, of slow changes of the exposure, as a share of it.
    """

    noise_grey: float = 1.0
    exposure_swing: float = 0.0

    def __post_init__(self) -> None:
        settle_float(self, "0 to 100", lambda grey: 0 <= grey <= 100, "noise_grey")
        settle_float(self, "0 to 0.5", lambda share: 0 <= share <= 0.5, "exposure_swing")


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedView:
    """A frame and how far away everything in it is.

    Attributes
    ----------
    frame : Frame
        The image with its index and time.
    depth : ndarray, shape (height, width)
        Distance along the ray through each pixel's centre, m; infinite for the sky, NaN (and a
        black image) where the lens has no ray.
    """

    frame: Frame
    depth: np.ndarray


class RenderedSequence:
    """A camera's path through a street, seen through any lens: a source of frames with truth.

    Frames are rendered when they are asked for, each by itself, so a long sequence takes no more
    memory than a short one, and frame 700 is the same whether or not 0 to 699 were seen before.

    Parameters
    ----------
    camera : Camera
        Any central camera; its image size must be known.
    path : Trajectory
        Poses ``world_from_cam`` with their times, in the world of `farpoint.synthetic.street`;
        those of `farpoint.synthetic.paths` or any other above ground.
    seed : int
        Of the street and the noise.
    imaging : ImagingOptions
        Noise and exposure.
    name : str
        Short name of the source.

    Attributes
    ----------
    timestamps : ndarray, shape (N,)
        Seconds.
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
    ):
        if camera.size is None:
            raise InputError("expected a camera of known image size", field="camera")
        if path.timestamps is None or len(path) == 0:
            raise InputError("expected at least one pose with its time", field="path")
        if not (path.world_from_body[:, 1, 3] < 0.0).all():
            raise InputError("expected positions above ground (y < 0)", field="path")
        if seed < 0:
            raise InputError(f"expected 0 or more, got {seed}", field="seed")
        self.camera = camera
        self.name = name
        self.count: int | None = len(path)
        self.timestamp_source = "the rendered path"
        self.calibration_path: Path | None = None
        self.notes: tuple[str, ...] = ()
        self.timestamps = path.timestamps
        self.world_from_cam = path.world_from_body
        self._seed = seed
        self._imaging = imaging or ImagingOptions()
        self._rays, self._steps = _ray_tables(camera, camera.size)
        self._scene = build_street(path.world_from_body[:, :3, 3], seed)

    def __len__(self) -> int:
        return len(self.timestamps)

    def __iter__(self) -> Iterator[Frame]:
        """Frames in order."""
        for index in range(len(self)):
            yield self.view(index).frame

    def view(self, index: int) -> RenderedView:
        """Render one frame, with depth."""
        shape = self._rays.shape[:2]
        radiance = np.empty(shape, np.float32)
        depth = np.empty(shape)
        render(
            self._scene,
            self.world_from_cam[index],
            self._rays,
            self._steps,
            radiance,
            depth,
            np.empty(shape, np.int64),
        )
        frame = Frame(
            index=index,
            timestamp=float(self.timestamps[index]),
            image=self._expose(radiance, depth, index),
            name=f"{index:06d}",
        )
        return RenderedView(frame=frame, depth=depth)

    def distances(self, index: int, pixels: np.ndarray) -> np.ndarray:
        """Distances (N,), m, along the rays of any pixels (N, 2) of a frame, by exact ray casting.

        Infinite for the sky, NaN where there is no ray.
        """
        return self._cast(index, self.camera.unproject(pixels))

    def transfer(self, pixels: np.ndarray, index0: int, index1: int) -> np.ndarray:
        """Where the scene points seen at ``pixels`` (N, 2) of one frame are seen in another.

        Returns
        -------
        ndarray, shape (N, 2)
            True pixels in frame ``index1``; NaN where the point is hidden there or out of view.
        """
        rays0 = self.camera.unproject(pixels)
        distance0 = self._cast(index0, rays0)
        cam1_from_cam0 = self.cam1_from_cam0(index0, index1)
        # Divided by the distance: the sky is an ordinary point, infinitely far away.
        points1 = rays0 @ cam1_from_cam0[:3, :3].T + cam1_from_cam0[:3, 3] / distance0[:, None]
        pixels1 = self.camera.project(points1)
        length = np.linalg.norm(points1, axis=1)
        seen_at = self._cast(index1, points1 / length[:, None])
        assert self.camera.size is not None
        upper = np.array(self.camera.size) - 0.5
        with np.errstate(invalid="ignore"):
            hidden = seen_at < (1.0 - _HIDDEN) * length * distance0
            inside = np.all((pixels1 > -0.5) & (pixels1 < upper), axis=1)
        return np.where((inside & ~hidden)[:, None], pixels1, np.nan)

    def cam1_from_cam0(self, index0: int, index1: int) -> np.ndarray:
        """True motion between two frames, shape (4, 4), metres."""
        return np.linalg.inv(self.world_from_cam[index1]) @ self.world_from_cam[index0]

    def write_truth(self, path: str | Path) -> None:
        """Write the true poses as a TUM file."""
        truth = Trajectory(timestamps=self.timestamps, world_from_body=self.world_from_cam)
        write_tum(path, truth)

    def _cast(self, index: int, rays: np.ndarray) -> np.ndarray:
        pose = self.world_from_cam[index]
        scene, distances = self._scene, np.empty(len(rays))
        directions = np.ascontiguousarray(rays @ pose[:3, :3].T)
        cast_rays(scene.blocks, scene.hills, pose[:3, 3].copy(), directions, distances)
        return distances

    def _expose(self, radiance: np.ndarray, depth: np.ndarray, index: int) -> np.ndarray:
        # Seeded by the frame, so that frames do not depend on those before them.
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
    """Rays (H, W, 3) of all pixels, and their change by a pixel right and down (H, W, 3, 2)."""
    width, height = size
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))

    def table(right: float, down: float) -> np.ndarray:
        return camera.unproject(
            np.stack([columns.ravel() + right, rows.ravel() + down], axis=1)
        ).reshape(height, width, 3)

    steps = (table(0.5, 0.0) - table(-0.5, 0.0), table(0.0, 0.5) - table(0.0, -0.5))
    return table(0.0, 0.0), np.stack(steps, axis=-1)
