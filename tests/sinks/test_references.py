"""Pictures that were looked at once are drawn the same for ever, or looked at again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from picture_similarity import assert_looks_like, at_phone_width, picture_similarity

from farpoint.camera import Camera, Equirectangular, KannalaBrandt
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus
from farpoint.sinks.overlay import PaletteName, draw_overlay

MakeResult = Callable[..., OdometryResult]
REFERENCES = Path(__file__).parent / "references"

PINHOLE = Camera.pinhole(640, 480, 500, 500, 319.5, 239.5)
LONG = Camera.pinhole(1226, 370, 707.0, 707.0, 601.9, 183.1)
FISHEYE = Camera(
    model=KannalaBrandt(fx=190.0, fy=190.0, cx=255.5, cy=255.5, k1=0.0), size=(512, 512)
)
ALL_AROUND = Camera(model=Equirectangular(width=640, height=320), size=(640, 320))


@dataclass(frozen=True)
class Scene:
    camera: Camera = PINHOLE
    result: dict[str, Any] = field(default_factory=dict)
    palette: PaletteName = "red-green"
    image: bool = True


SCENES = {
    "ahead": Scene(result={"sigma_deg": 1.5}),
    "aside": Scene(result={"heading": (1.0, 0.1, 0.2)}),
    "behind": Scene(result={"heading": (0.1, 0.05, -1.0)}, palette="orange-blue"),
    "fisheye": Scene(FISHEYE, {"heading": (1.0, 0.3, 0.4), "sigma_deg": 3.0}),
    "all-around": Scene(ALL_AROUND, {"heading": (1.0, 0.1, 0.4), "sigma_deg": 3.0}),
    "long": Scene(LONG),
    "rotation-only": Scene(result={"status": PoseStatus.ROTATION_ONLY}),
    "failed": Scene(LONG, {"status": PoseStatus.FAILED}, image=False),
}


def picture_of(scene: Scene, make_result: MakeResult, **changes: object) -> np.ndarray:
    result = make_result(3, scene_camera=scene.camera, **scene.result | changes)
    assert scene.camera.size is not None
    width, height = scene.camera.size
    image = np.linspace(60, 180, height, dtype=np.float32)[:, None].repeat(width, 1)
    image = image.astype(np.uint8) if scene.image else None
    return draw_overlay(image, result, scene.camera, scene.palette)


@pytest.mark.skipif(cv2.__version__ < "5", reason="OpenCV 4 has other letters")
@pytest.mark.parametrize("name", list(SCENES))
def test_the_display_looks_as_it_did(name: str, make_result: MakeResult, tmp_path: Path) -> None:
    picture = picture_of(SCENES[name], make_result)
    assert_looks_like(picture, REFERENCES / f"{name}.png", tmp_path)


def test_every_reference_has_its_scene() -> None:
    assert {path.stem for path in REFERENCES.iterdir()} == set(SCENES)


def test_visible_differences_are_detected_and_invisible_ones_are_not(
    make_result: MakeResult,
) -> None:
    scene = SCENES["ahead"]
    picture = at_phone_width(picture_of(scene, make_result))

    def same(other: np.ndarray) -> bool:
        return picture_similarity(picture, other).same

    grain = np.random.default_rng(0).integers(-3, 4, picture.shape)
    assert same(np.clip(picture + grain, 0, 255).astype(np.uint8))
    hair = np.array([[1.0, 0.0, 0.15], [0.0, 1.0, 0.15]])
    assert same(cv2.warpAffine(picture, hair, picture.shape[1::-1], borderMode=cv2.BORDER_REFLECT))

    other_colours = replace(scene, palette="orange-blue")
    assert not same(at_phone_width(picture_of(other_colours, make_result)))
    # The epipole 8 px aside, an ellipse a third larger, a value that is not there.
    moved = picture_of(scene, make_result, heading=(0.216, 0.05, 1.0))
    assert not same(at_phone_width(moved))
    larger = picture_of(scene, make_result, sigma_deg=2.0)
    assert not same(at_phone_width(larger))
    erased = picture.copy()
    erased[-28:-14, 60:130] = erased[-1, -1]
    assert not same(erased)
