"""An evaluation as text, as JSON, and as rows of a table."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict

import numpy as np

from farpoint.metrics.evaluation import Evaluation, MotionEvaluation, TrajectoryEvaluation
from farpoint.metrics.halves import HalvesEvaluation
from farpoint.metrics.pairs import PairErrors
from farpoint.metrics.path_consistency import PathConsistency, PathFigure
from farpoint.metrics.statistics import Consistency, Coverage, Summary
from farpoint.metrics.stretches import StretchFigure

__all__ = ["PAIR_COLUMNS", "pair_rows", "to_json", "to_text"]

PAIR_COLUMNS = (
    "status",
    "true_rotation_deg",
    "true_translation",
    "rotation_error_deg",
    "direction_error_deg",
    "dtheta_x_rad",
    "dtheta_y_rad",
    "dtheta_z_rad",
    "dbeta_0_rad",
    "dbeta_1_rad",
    "rotation_nees",
    "direction_nees",
    "pose_nees",
)
"""Names of the columns of `pair_rows`."""

DEG = 180.0 / math.pi


def pair_rows(errors: PairErrors) -> Iterator[list[str]]:
    """One CSV row for each pair, with the columns `PAIR_COLUMNS`; undefined fields are empty."""
    numbers = np.column_stack(
        [
            errors.true_rotation_angle_rad * DEG,
            errors.true_translation,
            errors.rotation_angle_rad * DEG,
            errors.direction_angle_rad * DEG,
            errors.errors,
            errors.rotation_nees,
            errors.direction_nees,
            errors.pose_nees,
        ]
    )
    for status, row in zip(errors.statuses, numbers, strict=True):
        yield [status.value, *("" if math.isnan(value) else f"{value:.9g}" for value in row)]


def to_json(evaluation: Evaluation) -> str:
    """JSON of the whole record, with units in the names; a number that is not finite is null."""
    return json.dumps(_finite(asdict(evaluation)), indent=2, allow_nan=False)


def to_text(evaluation: Evaluation) -> str:
    """Aligned tables for a terminal. Without truth, only figures that need no truth are shown."""
    motions = evaluation.motions
    lines = _motion_lines(motions)
    if motions.pairs_with_truth:
        lines += ["", *_consistency_lines(motions, "truths", "errors")]
    if evaluation.halves is not None:
        lines += ["", *_halves_lines(evaluation.halves)]
    if evaluation.trajectory is not None:
        lines += ["", *_trajectory_lines(evaluation.trajectory)]
    elif evaluation.trajectory_fault is not None:
        lines += ["", f"trajectory not compared: {evaluation.trajectory_fault}"]
    if evaluation.path is not None:
        lines += ["", *_path_lines(evaluation.path)]
    if evaluation.stretches:
        lines += ["", *_stretch_lines(evaluation.stretches)]
    return "\n".join(lines) + "\n"


def _motion_lines(motions: MotionEvaluation) -> list[str]:
    counts = "   ".join(f"{name} {count}" for name, count in motions.statuses.items())
    lines = [f"pairs {motions.pairs} ({motions.pairs_with_truth} with truth)   {counts}"]
    if motions.directions_not_counted:
        lines.append(
            f"direction not counted for {motions.directions_not_counted} pairs: "
            f"true translation below {motions.min_translation:g}"
        )
    if motions.directions_opposed:
        lines.append(f"direction 90 deg or more off for {motions.directions_opposed} pairs")
    errors = [
        ("rotation, deg", motions.rotation_rad),
        ("direction, deg", motions.direction_rad),
    ]
    claims = [
        ("claimed rotation, deg", motions.rotation_sigma_rad),
        ("claimed direction, deg", motions.direction_sigma_rad),
    ]
    figure_rows = errors + claims if motions.pairs_with_truth else claims
    rows = [(name, *_summary_cells(figures.scaled(DEG))) for name, figures in figure_rows]
    return [*lines, "", *_table(("error", *_SUMMARY_HEAD), rows)]


def _consistency_lines(
    found: MotionEvaluation | HalvesEvaluation, points: str, errors: str
) -> list[str]:
    """Lines of errors against covariances; ``points`` and ``errors`` name what was compared."""
    head = ("covariance", "dof", "pairs", "NEES mean", "95 % bounds", "median")
    head += ("in 68 %", "in 95 %", "sigma, deg", "sigma/error")
    kinds = (("rotation", found.rotation), ("direction", found.direction), ("pose", found.pose))
    return [
        *_table(head, [(name, *_consistency_cells(kind)) for name, kind in kinds]),
        f"in n %: share of {points} inside the n % region [95 % interval of that share].",
        "sigma: median of the claimed root mean square error (the pose's: of all 5 components).",
        f"sigma/error: claimed over true size of the {errors}, from the median NEES; 1 is honest.",
    ]


def _halves_lines(halves: HalvesEvaluation) -> list[str]:
    """Lines of the split-half test: differences of estimates from two halves of the matches."""
    neither = halves.pairs - halves.compared - halves.compared_in_rotation
    r = halves.ratio
    opposed = f"opposite directions, not counted: {r.opposed} pairs"
    return [
        f"two halves of the matches, {halves.pairs} pairs: {halves.compared} compared, "
        f"{halves.compared_in_rotation} in rotation alone, {neither} not at all",
        f"difference over covariance, all together: {_number(r.ratio)} "
        f"(1 is honest; chance: {_number(r.low)} to {_number(r.high)})",
        *([opposed] if r.opposed else []),
        "",
        *_consistency_lines(halves, "differences", "differences"),
    ]


def _trajectory_lines(trajectory: TrajectoryEvaluation) -> list[str]:
    t = trajectory
    lines = [
        f"trajectory: {t.poses} poses, true path {t.path_length:.3f}, scale {t.scale:.6g}, "
        f"drift of it {_number(100.0 * t.scale_drift)} %"
    ]
    lines += _table(
        ("error", *_SUMMARY_HEAD),
        [
            ("ATE, Sim(3) aligned", *_summary_cells(t.ate_sim3)),
            ("ATE, SE(3) aligned", *_summary_cells(t.ate_se3)),
            (f"RPE over {t.delta_frames}, translation", *_summary_cells(t.rpe_translation)),
            (f"RPE over {t.delta_frames}, deg", *_summary_cells(t.rpe_rotation_rad.scaled(DEG))),
        ],
    )
    if t.segments:
        rows = [
            (
                "all" if s.length is None else f"{s.length:g}",
                str(s.count),
                _number(100.0 * s.translation_ratio),
                _number(DEG * s.rotation_rad_per_length),
            )
            for s in t.segments
        ]
        head = ("KITTI segments", "count", "translation, %", "rotation, deg/m")
        lines += ["", *_table(head, rows)]
    return [*lines, "Lengths in the unit of the truth; RPE and segments after the Sim(3) scale."]


def _path_lines(path: PathConsistency) -> list[str]:
    rows = (
        ("orientation", path.orientation),
        ("position", path.position),
        ("pose", path.pose),
        ("position, any scale", path.position_any_scale),
        ("scale", path.scale),
    )
    head = ("covariance of the path", "dof", "segments", "poses", "NEES mean", "at the end")
    head += ("95 % bounds", "")
    cells = [
        (
            name,
            str(f.dof),
            str(f.segments),
            str(f.poses),
            _number(f.mean_nees),
            _number(f.end_nees),
            f"[{_number(f.nees_low)}, {_number(f.nees_high)}]",
            _verdict(f),
        )
        for name, f in rows
    ]
    lengths = path.lengths
    taken = "pose" if path.unit_is_given else "pose and the length of its first motion"
    return [
        *_table(head, cells),
        f"lengths within 1.96 sigma: {lengths.coverage95.share:.3f} of {lengths.count}, "
        f"sigma/error {_number(lengths.sigma_over_error)}, "
        f"median sigma {_number(100.0 * lengths.median_sigma)} %",
        f"Taken as true of each segment: its first {taken}; nothing is fitted.",
        "Bounds: of one sample for each segment, since errors add up from pose to pose.",
    ]


def _stretch_lines(stretches: Sequence[StretchFigure]) -> list[str]:
    rows = [
        (
            _stretch_name(s),
            *(f"{kind.share:.2f}" if kind.count else "-" for kind in (s.lengths, s.rotations)),
            str(s.rotations.count),
        )
        for s in stretches
    ]
    return [
        *_table(("stretches of the path", "lengths", "rotations", "stretches"), rows),
        "Share of distances and rotations between their ends that lie within their stated 95 %:",
        "0.95 is honest, less claims too much, more too little. One scale for the whole segment.",
    ]


def _stretch_name(stretch: StretchFigure) -> str:
    of = "its poses" if math.isnan(stretch.length) else f"it ({_number(stretch.length)})"
    return f"over {100.0 * stretch.share:g} % of {of}"


def _verdict(figure: PathFigure) -> str:
    if figure.kept or not figure.segments:
        return ""
    return "too sure" if figure.mean_nees > figure.nees_high else "not sure enough"


_SUMMARY_HEAD = ("count", "median", "mean", "rmse", "p95", "max")


def _summary_cells(summary: Summary) -> tuple[str, ...]:
    s = summary
    return (str(s.count), *(_number(v) for v in (s.median, s.mean, s.rmse, s.p95, s.max)))


def _consistency_cells(c: Consistency) -> tuple[str, ...]:
    return (
        str(c.dof),
        str(c.count),
        _number(c.mean_nees),
        f"[{_number(c.nees_low)}, {_number(c.nees_high)}]",
        _number(c.median_nees),
        _coverage_cell(c.coverage68),
        _coverage_cell(c.coverage95),
        _number(c.median_sigma * DEG),
        _number(c.sigma_over_error),
    )


def _coverage_cell(c: Coverage) -> str:
    return f"{c.share:.3f} [{c.low:.3f}, {c.high:.3f}]" if c.count else "-"


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.4g}"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table, with the first column aligned left and all other columns right."""
    cells = [head, *rows]
    widths = [max(len(row[k]) for row in cells) for k in range(len(head))]
    return [
        "  ".join(
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    ]


def _finite(value: object) -> object:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
