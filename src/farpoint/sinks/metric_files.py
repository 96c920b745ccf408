"""Conversion of the files of a run to metres."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from farpoint.aiding import MetricFit
from farpoint.errors import InputError
from farpoint.sinks.files import replacing, text_output
from farpoint.sinks.motions import COLUMNS as MOTIONS_COLUMNS
from farpoint.sinks.positions import COLUMNS, PositionRow, iter_position_rows, position_line
from farpoint.trajectory.files import kitti_line, tum_line

__all__ = ["metric_covariance", "put_in_metres"]

_SCALE = MOTIONS_COLUMNS.index("scale")


def put_in_metres(folder: Path, fit: MetricFit) -> None:
    """Rewrite ``positions.csv``, the trajectories and the lengths of ``motions.csv``.

    Each step of the path is multiplied by the metric scale at the time of the step. This product
    corrects the drift of the scale. Orientations do not change. The files are processed line by
    line, so memory does not grow with the length of a run.

    Raises
    ------
    InputError
        If a file cannot be read or written.
    """
    segments: dict[int, int] = {}  # by frame; motions.csv has no column of segments
    names = ("positions.csv", "trajectory.tum", "trajectory.kitti", "motions.csv")
    paths = [folder / name for name in names]
    with ExitStack() as parts:  # all new files are complete before the first is renamed
        new = [parts.enter_context(replacing(path)) for path in paths]
        with ExitStack() as opened:
            positions, tum, kitti, motions = (
                opened.enter_context(text_output(path, part))
                for path, part in zip(paths, new, strict=True)
            )
            positions(",".join(COLUMNS) + "\n")
            for row in _in_metres(iter_position_rows(folder / "positions.csv"), fit):
                segments[row.frame] = row.segment
                positions(position_line(row))
                tum(tum_line(row.timestamp, row.world_from_cam))
                kitti(kitti_line(row.world_from_cam))
            for line in _motions_in_metres(folder / "motions.csv", fit, segments):
                motions(line)


def _in_metres(rows: Iterator[PositionRow], fit: MetricFit) -> Iterator[PositionRow]:
    before, metric = None, np.zeros(3)
    for row in rows:
        position = row.world_from_cam[:3, 3].copy()
        factor, sigma = fit.at(row.timestamp, row.segment)
        if before is not None:
            metric = metric + factor * (position - before)
        before = position
        pose = row.world_from_cam.copy()
        pose[:3, 3] = metric
        yield row._replace(
            world_from_cam=pose,
            covariance=metric_covariance(row.covariance, metric, factor, sigma),
        )


def metric_covariance(
    covariance: np.ndarray, position: np.ndarray, factor: float, sigma: float
) -> np.ndarray:
    """The covariance in metres, including the metric scale's error, which affects the position."""
    stretch = np.ones(7)
    stretch[3:6] = factor
    metric = covariance * np.outer(stretch, stretch)
    along = np.concatenate([np.zeros(3), position, [1.0]])
    metric[6, :] = metric[:, 6] = 0.0  # the metric scale replaces the scale of the path
    return metric + sigma**2 * np.outer(along, along)


def _motions_in_metres(path: Path, fit: MetricFit, segments: dict[int, int]) -> Iterator[str]:
    for number, line in enumerate(_lines(path)):
        cells = line.split(",")
        if number and cells[_SCALE]:
            length, sigma = float(cells[_SCALE]), float(cells[_SCALE + 1] or 0.0)
            factor, scale_sigma = fit.at(float(cells[1]), segments.get(int(cells[3]), 0))
            cells[_SCALE] = repr(factor * length)
            cells[_SCALE + 1] = repr(factor * math.hypot(sigma, scale_sigma * length))
        yield ",".join(cells)


def _lines(path: Path) -> Iterator[str]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            yield from file
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
