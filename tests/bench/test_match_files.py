from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from farpoint.bench.match_files import find_match_files, read_matches
from farpoint.errors import InputError

RNG = np.random.default_rng(0)


def arrays() -> dict[str, np.ndarray]:
    return {
        "x0": RNG.uniform(0, 400, (7, 2)).astype(np.float32),
        "x1": RNG.uniform(0, 400, (7, 2)).astype(np.float32),
        "start": np.array([0, 3, 7]),
        "R": np.array([np.eye(3), np.diag([1.0, -1.0, -1.0])]),
        "t": np.array([[0.1, 0.0, 0.0], [0.0, 0.0, 2.0]]),
        "camera": np.array([500.0, 501.0, 320.0, 240.0, 0.1, 0.0, 0.0, 0.0, 0.0]),
        "size": np.array([640, 480]),
    }


def test_pairs_are_cut_out_of_the_stack(tmp_path: Path):
    written = arrays()
    np.savez(tmp_path / "drive.npz", **written)
    found = read_matches(tmp_path / "drive.npz")
    assert found.name == "drive"
    assert [len(views.points0) for views in found.views] == [3, 4]
    np.testing.assert_array_equal(found.views[1].points1, written["x1"][3:])
    assert found.views[1].points1.dtype == np.float64
    np.testing.assert_array_equal(found.views[1].translation_cam1_from_cam0, [0, 0, 2])
    camera = found.views[0].camera
    assert camera.size == (640, 480)
    assert (camera.model.fy, camera.model.distortion[0]) == (501.0, 0.1)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("x0", None),
        ("x0", np.zeros((7, 3))),
        ("x1", np.zeros((6, 2))),
        ("x1", np.full((7, 2), np.nan)),
        ("start", np.array([0, 3, 8])),
        ("start", np.array([0, 8, 7])),
        ("start", np.array([0, 7])),
        ("R", np.zeros((2, 3))),
        ("t", np.zeros((3, 3))),
        ("camera", np.zeros(4)),
        ("camera", np.array([-1.0, 1, 1, 1, 0, 0, 0, 0, 0])),
        ("size", np.array([0, 480])),
        ("size", np.array(["a", "b"])),
    ],
)
def test_faults_name_file_and_array(tmp_path: Path, field: str, value: np.ndarray | None):
    path = tmp_path / "bad.npz"
    changed = arrays() | {field: value}
    np.savez(path, **{name: array for name, array in changed.items() if array is not None})
    with pytest.raises(InputError) as caught:
        read_matches(path)
    assert caught.value.file == str(path)
    assert caught.value.field is not None
    expected = "camera" if field == "size" and value is not None and value[0] == 0 else field
    assert caught.value.field.startswith(expected)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04 cut off"])
def test_what_is_no_archive_is_named(tmp_path: Path, content: bytes):
    path = tmp_path / "bad.npz"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"expected an \.npz archive"):
        read_matches(path)


def test_an_archive_cut_short_is_named(tmp_path: Path):
    path = tmp_path / "cut.npz"
    np.savez(path, **arrays())
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"expected an \.npz archive"):
        read_matches(path)


def test_files_are_found_where_they_may_be(tmp_path: Path):
    (tmp_path / "data" / "pairs").mkdir(parents=True)
    for name in ("data/pairs/b.npz", "data/pairs/a.npz", "data/c.npz", "data/d.txt", "e.npz"):
        (tmp_path / name).write_bytes(b"")
    places = (tmp_path / "e.npz", tmp_path / "data")
    found = [str(path.relative_to(tmp_path)) for path in find_match_files(places)]
    assert found == ["e.npz", "data/c.npz", "data/pairs/a.npz", "data/pairs/b.npz"]
    with pytest.raises(InputError, match=r"nowhere.*no such file or folder"):
        find_match_files((tmp_path / "nowhere",))
