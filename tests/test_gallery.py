"""The pictures of the documentation are those that its command draws."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import cv2
import pytest
from picture_similarity import at_phone_width, picture_similarity

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture(scope="module")
def gallery() -> ModuleType:
    spec = importlib.util.spec_from_file_location("gallery", DOCS / "gallery.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["gallery"] = module  # where dataclasses look for their annotations
    spec.loader.exec_module(module)
    return module


def pictures_in(page: Path) -> set[str]:
    return set(re.findall(r"\(images/([^)]*)\)", page.read_text()))


def test_every_picture_has_its_scene_and_is_shown(gallery: ModuleType) -> None:
    drawn = {f"{name}.webp" for name in gallery.SCENES}
    shown = {page.name: pictures_in(page) for page in DOCS.glob("*.md")}
    assert shown["gallery.md"] == drawn
    assert shown["viewer.md"] == {"viewer.webp"}
    assert {path.name for path in (DOCS / "images").iterdir()} == drawn | {"viewer.webp"}
    for path in (DOCS / "images").iterdir():
        assert path.stat().st_size < 300_000


@pytest.mark.skipif(cv2.__version__ < "5", reason="OpenCV 4 has other letters")
def test_the_command_draws_them(
    gallery: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = cv2.imread(str(DOCS / "images" / "standing.webp"))
    monkeypatch.setattr(gallery, "IMAGES", tmp_path / "images")
    monkeypatch.setattr(sys, "argv", ["gallery.py", "standing"])
    gallery.main()
    drawn = cv2.imread(str(tmp_path / "images" / "standing.webp"))
    found = picture_similarity(at_phone_width(drawn), at_phone_width(kept))
    # Digits, and tracks at the edge of what can be tracked, may change with the estimator.
    assert found.mean < 1.5
    assert found.share < 0.02
