"""What the tests of the benchmark share."""

from __future__ import annotations

import importlib
from collections.abc import Callable

import numpy as np
import pytest

from farpoint.bench.estimators import Estimator, Motion
from farpoint.bench.estimators import estimator as estimator_module
from farpoint.bench.scenes import draw_scenes
from farpoint.bench.views import TwoViews, views_of_scene

UNSEEDED = ("pymagsac", "pygcransac")  # draw other samples in every call
PEERS = ("poselib", "pycolmap", "cv2", *UNSEEDED)


def silent(*_: object) -> object:
    """Progress, text or an answer that is nothing."""


def absent(monkeypatch: pytest.MonkeyPatch, *modules: str) -> None:
    """Make imports by the benchmark fail for these libraries."""

    def refuse(name: str):
        if name in modules:
            raise ImportError(name)
        return importlib.import_module(name)

    class Refusing:
        import_module = staticmethod(refuse)

    monkeypatch.setattr(estimator_module, "importlib", Refusing)


def some_views(count: int, *, seed: int = 0, noise_px: float = 0.2) -> list[TwoViews]:
    scenes = draw_scenes(
        count,
        np.random.default_rng(seed),
        baseline_m=0.2,
        far_share=0.3,
        matches=60,
        outliers=6,
        noise_px=noise_px,
    )
    return [views_of_scene(scene) for scene in scenes]


def estimator_of(name: str, answer: Callable[[TwoViews], Motion | None]) -> Estimator:
    return Estimator(name=name, settings="", prepare=lambda views, _seed: lambda: answer(views))
