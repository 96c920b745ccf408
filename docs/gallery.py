"""Draw the pictures of the documentation: ``python docs/gallery.py``, a minute or two.

Every picture is the working display of a run through the rendered street, as ``overlay.mp4`` shows
it; nothing is drawn by hand. Without an argument all are drawn, otherwise those that are named.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from farpoint.camera import Camera
from farpoint.camera.equirectangular import Equirectangular
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.odometry import Odometry, OdometryResult
from farpoint.sinks.overlay import PaletteName, draw_overlay
from farpoint.synthetic import (
    RenderedSequence,
    pure_rotation,
    sideways,
    standing_still,
    street_drive,
)
from farpoint.trajectory.files import Trajectory

IMAGES = Path(__file__).parent / "images"

DASH = Camera.pinhole(640, 360, 490.0, 490.0, 319.5, 179.5)
FISHEYE = Camera(  # 195 degrees, the lens of a visual-inertial sensor
    model=KannalaBrandt(
        fx=190.98, fy=190.97, cx=254.93, cy=256.90, k1=0.00348, k2=0.00072, k3=-0.00205, k4=0.00020
    ),
    size=(512, 512),
)
PANORAMA = Camera(model=Equirectangular(width=960, height=480), size=(960, 480))


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One picture: the last of a few frames."""

    camera: Camera
    path: Callable[[int], Trajectory]
    last: int = 12
    first: int = 0
    palette: PaletteName = "red-green"


def drive(frames: int) -> Trajectory:
    return street_drive(frames, seed=1)


def backwards(frames: int) -> Trajectory:
    """The drive played from its end."""
    path = drive(frames)
    return Trajectory(timestamps=path.timestamps, world_from_body=path.world_from_body[::-1])


def crawl(frames: int) -> Trajectory:
    """The drive in slow motion: four millimetres from frame to frame."""
    return street_drive(frames, fps=2400.0, seed=1)


def strafe(frames: int) -> Trajectory:
    return sideways(frames, speed_m_s=9.0)


SCENES = {
    "bend": Scene(camera=DASH, path=drive, first=36, last=46),
    "slow": Scene(camera=DASH, path=crawl),
    "fisheye": Scene(camera=FISHEYE, path=drive),
    "panorama": Scene(camera=PANORAMA, path=drive),
    "backwards": Scene(camera=DASH, path=backwards),
    "sideways": Scene(camera=DASH, path=strafe),
    "turning": Scene(camera=DASH, path=pure_rotation, last=10),
    "standing": Scene(camera=DASH, path=standing_still, last=4),
    "orange-blue": Scene(camera=DASH, path=drive, palette="orange-blue"),
}


def picture_of(scene: Scene) -> np.ndarray:
    """The working display of the scene's last frame, RGB."""
    frames = RenderedSequence(scene.camera, scene.path(scene.last + 1), seed=1)
    odometry = Odometry(scene.camera)
    result: OdometryResult | None = None
    image: np.ndarray | None = None
    for index in range(scene.first, scene.last + 1):
        frame = frames.view(index).frame
        image = frame.image
        result = odometry.process(image, frame.timestamp)
    assert result is not None
    return draw_overlay(image, result, scene.camera, scene.palette)


def main() -> None:
    IMAGES.mkdir(exist_ok=True)
    for name in sys.argv[1:] or SCENES:
        picture = picture_of(SCENES[name])
        path = IMAGES / f"{name}.webp"
        _, data = cv2.imencode(".webp", picture[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, 80])
        path.write_bytes(data.tobytes())
        print(
            f"{path.relative_to(IMAGES.parent)}: {picture.shape[1]}x{picture.shape[0]}, "
            f"{len(data) / 1024:.0f} kB"
        )


if __name__ == "__main__":
    main()
