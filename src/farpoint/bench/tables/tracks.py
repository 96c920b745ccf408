"""Coverage of the covariances for OpenCV's tracks and matches, whose noise is not given."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from farpoint.bench.cameras import PINHOLE
from farpoint.bench.consistency import CONSISTENCY_COLUMNS, consistency_cells, pose_errors
from farpoint.bench.feature_matcher import FeatureMatcher, Matcher
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.plain_script import PlainScript
from farpoint.bench.table import Cell, Column, Table
from farpoint.pose import PoseStatus, RelativePose, estimate_relative_pose
from farpoint.synthetic import RenderedSequence, street_drive

__all__ = ["tracks_table"]

_PAIRS = 60
_PAIRS_PER_STREET = 3


_MATCHERS: dict[str, Callable[[], Matcher]] = {
    "Lucas-Kanade, 500 corners": partial(PlainScript, PINHOLE, 500),
    "Lucas-Kanade, 150 corners": partial(PlainScript, PINHOLE, 150),
    "SIFT": partial(FeatureMatcher, "SIFT"),
    "ORB": partial(FeatureMatcher, "ORB"),
}
_FPS = (30.0, 10.0)


def tracks_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """The table with a row for each kind of match and frame rate, yielded after each row."""
    rows: list[tuple[Cell, ...]] = []
    for name, fps in itertools.product(_MATCHERS, _FPS):
        rows.append((name, round(fps), *_figures(name, fps, options, progress)))
        yield Table(
            name="tracks",
            title="Coverage of estimates from OpenCV's tracks and features, rendered streets",
            command=options.command("tracks"),
            columns=(
                Column("kind"),
                Column("fps"),
                Column("pairs"),
                Column("matches"),
                Column("OK"),
                *CONSISTENCY_COLUMNS,
            ),
            rows=tuple(rows),
            notes=(
                "tracks are those of the basic OpenCV program, features are matched by ratio "
                f"test; {_PAIRS_PER_STREET} pairs in each street, every other one",
                "without given covariances",
                "matches: median number per pair; the other columns are those of the table of "
                "coverage",
            ),
        )


def _figures(kind: str, fps: float, options: BenchOptions, progress: Progress) -> tuple[Cell, ...]:
    pairs = options.pairs or _PAIRS
    name = f"{kind} at {fps:g} frames a second"
    poses: list[RelativePose] = []
    truths, sizes = [], []
    for street in range(math.ceil(pairs / _PAIRS_PER_STREET)):
        progress(name, len(poses), pairs)
        seed = options.seed + street
        path = street_drive(2 * _PAIRS_PER_STREET, fps, seed)
        sequence = RenderedSequence(PINHOLE, path, seed=seed)
        images = [frame.image for frame in sequence if frame.image is not None]
        matcher = _MATCHERS[kind]()
        for first in range(0, 2 * _PAIRS_PER_STREET, 2)[: pairs - len(poses)]:
            points0, points1 = matcher.match(images[first], images[first + 1])
            poses.append(estimate_relative_pose(points0, points1, PINHOLE, seed=options.seed))
            truths.append(sequence.cam1_from_cam0(first, first + 1))
            sizes.append(len(points0))
    progress(name, pairs, pairs)
    truth = np.array(truths)
    return (
        pairs,
        round(float(np.median(sizes))),
        sum(pose.status is PoseStatus.OK for pose in poses),
        *consistency_cells(pose_errors(poses, truth[:, :3, :3], truth[:, :3, 3])),
    )
