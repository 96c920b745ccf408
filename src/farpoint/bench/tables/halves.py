"""Split-half test on the tracks of real images, which needs no true motion."""

from __future__ import annotations

from collections.abc import Iterator

from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.sequences import Sequence, find_sequences
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.tables.halves_by_cells import (
    PARTS,
    HalvesBySplit,
    halves_by_cells,
    split_halves,
)
from farpoint.frames import open_frames
from farpoint.metrics import SplitHalf, evaluate_halves
from farpoint.odometry import Odometry, OdometryOptions

__all__ = ["halves_table"]

# Runs of the odometry with different seeds. The tracks differ, too, because they depend on earlier
# estimates.
_RUNS = 10

_COLUMNS = (
    Column("sequence"),
    Column("runs"),
    Column("pairs"),
    Column("in_pose"),
    Column("in_rotation"),
    Column("opposed"),
    Column("ratio", 2),
    Column("lowest_run", 2),
    Column("highest_run", 2),
    Column("pose_68", 3),
    Column("pose_95", 3),
)


def halves_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """A table with a row for each image sequence of the data, and the table by image cells.

    The tables are yielded after each row.
    """
    sequences: dict[str, list[HalvesBySplit]] = {}
    seeds = range(options.seed, options.seed + _RUNS)
    for sequence in find_sequences(options.data):
        runs: list[HalvesBySplit] = []
        for done, seed in enumerate(seeds):
            progress(f"halves of {sequence.name}", done, len(seeds))
            runs.append(_run(sequence, seed))
        progress(f"halves of {sequence.name}", len(seeds), len(seeds))
        sequences[sequence.name] = runs
        yield _table(sequences, seeds, options)
        yield halves_by_cells(sequences, options.command("halves"))


def _run(sequence: Sequence, seed: int) -> HalvesBySplit:
    """The test on every pair of frames of one run."""
    assert sequence.source is not None
    odometry = Odometry(sequence.camera, OdometryOptions(seed=seed))
    return split_halves(odometry, odometry.run(open_frames(sequence.source)))


def _table(sequences: dict[str, list[HalvesBySplit]], seeds: range, options: BenchOptions) -> Table:
    return Table(
        name="halves",
        title="Split halves of the tracks of real images: difference of both estimates over its "
        "covariance",
        command=options.command("halves"),
        columns=_COLUMNS,
        rows=tuple(
            (name, *_cells([run[PARTS] for run in runs])) for name, runs in sequences.items()
        ),
        notes=(
            "ratio: squared differences over their expectation by the covariances; 1 for honest "
            "covariances, above 1 if they are too small; of all runs together, and of the runs "
            "with the lowest and the highest ratio",
            "in_pose: pairs whose halves both have a direction; in_rotation: pairs whose halves "
            "both have a rotation",
            "opposed: pairs whose halves have opposite directions; they are in no ratio",
            "pose_68, pose_95: share of the pairs in_pose whose difference is within the 68 % "
            "and 95 % region",
            "the tracks of one of 16 parts of the image are in the same half; seeds of the runs: "
            f"{seeds[0]} to {seeds[-1]}",
        ),
    )


def _cells(runs: list[list[SplitHalf]]) -> tuple[Cell, ...]:
    alone = [evaluate_halves(run).ratio.ratio for run in runs]
    found = evaluate_halves([half for run in runs for half in run])
    return (
        len(runs),
        found.pairs,
        found.compared,
        found.compared_in_rotation,
        found.ratio.opposed,
        found.ratio.ratio,
        min(alone),
        max(alone),
        found.pose.coverage68.share,
        found.pose.coverage95.share,
    )
