"""Matches of real image pairs with their true motions, from ``.npz`` files."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from farpoint.bench.views import TwoViews
from farpoint.camera import Camera
from farpoint.errors import InputError

__all__ = ["MatchFile", "find_match_files", "read_matches"]

_SHAPES = {
    "x0": (None, 2),
    "x1": (None, 2),
    "start": (None,),
    "R": (None, 3, 3),
    "t": (None, 3),
    "camera": (9,),
    "size": (2,),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchFile:
    """A file of matches.

    Attributes
    ----------
    name : str
        Stem of the file.
    views : tuple of TwoViews
        The pairs in the file.
    """

    name: str
    views: tuple[TwoViews, ...]


def find_match_files(places: tuple[Path, ...]) -> tuple[Path, ...]:
    """The ``.npz`` files among ``places``, in these folders, and in subfolders ``pairs``."""
    files: list[Path] = []
    for place in places:
        if not place.exists():
            raise InputError("no such file or folder", file=place, field="data")
        if place.is_file():
            files.append(place)
        else:
            files += sorted(place.glob("*.npz")) + sorted((place / "pairs").glob("*.npz"))
    return tuple(file for file in files if file.suffix == ".npz")


def read_matches(path: Path) -> MatchFile:
    """Read the pairs of a file.

    The archive has these arrays. ``x0`` and ``x1`` (M, 2) are the pixels of all pairs, stacked.
    ``start`` (P+1,) gives the rows ``start[k]:start[k+1]`` of pair k. ``R`` (P, 3, 3) and ``t`` (P,
    3) are the true motions cam1_from_cam0, with ``t`` in metres. ``camera`` (9,) has the values
    ``fx fy cx cy k1 k2 p1 p2 k3``. ``size`` (2,) is width and height of the images, px.

    Raises
    ------
    InputError
        If the file is no such archive, if an array is missing, has another shape or is not finite,
        or if ``start`` does not divide the rows into pairs. The message names file and array.
    """
    arrays = _read_arrays(path)
    start, pairs = arrays["start"].astype(np.int64), len(arrays["R"])
    rows = len(arrays["x0"])
    if len(arrays["x1"]) != rows:
        raise InputError(f"expected shape ({rows}, 2) as x0", file=path, field="x1")
    if len(arrays["t"]) != pairs:
        raise InputError(f"expected shape ({pairs}, 3) for {pairs} R", file=path, field="t")
    if len(start) != pairs + 1 or start[0] != 0 or start[-1] != rows or (np.diff(start) < 0).any():
        raise InputError(
            f"expected {pairs + 1} rising rows from 0 to {rows}", file=path, field="start"
        )
    camera = _camera(arrays, path)
    views = tuple(
        TwoViews(
            camera=camera,
            points0=arrays["x0"][start[k] : start[k + 1]],
            points1=arrays["x1"][start[k] : start[k + 1]],
            rotation_cam1_from_cam0=arrays["R"][k],
            translation_cam1_from_cam0=arrays["t"][k],
        )
        for k in range(pairs)
    )
    return MatchFile(name=path.stem, views=views)


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        # Opened here, because np.load does not close a file that is no archive.
        with path.open("rb") as file:
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise InputError("expected an .npz archive of arrays", file=path)
            missing = [name for name in _SHAPES if name not in archive]
            if missing:
                raise InputError("expected an array of this name", file=path, field=missing[0])
            arrays = {name: archive[name] for name in _SHAPES}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"expected an .npz archive of arrays: {error}", file=path) from error
    return {name: _checked(path, name, array) for name, array in arrays.items()}


def _checked(path: Path, name: str, array: np.ndarray) -> np.ndarray:
    expected = _SHAPES[name]
    fits = array.ndim == len(expected) and all(
        size in (None, actual) for size, actual in zip(expected, array.shape, strict=True)
    )
    if not fits:
        words = ", ".join("N" if size is None else str(size) for size in expected)
        raise InputError(f"expected shape ({words}), got {array.shape}", file=path, field=name)
    if array.dtype.kind not in "iuf" or not np.isfinite(array).all():
        raise InputError("expected finite numbers", file=path, field=name)
    return np.ascontiguousarray(array, dtype=np.float64)


def _camera(arrays: dict[str, np.ndarray], path: Path) -> Camera:
    fx, fy, cx, cy, *distortion = map(float, arrays["camera"])
    width, height = map(int, arrays["size"])
    try:
        return Camera.pinhole(width, height, fx, fy, cx, cy, distortion if any(distortion) else ())
    except InputError as error:
        raise InputError(error.problem, file=path, field=f"camera: {error.field}") from error
