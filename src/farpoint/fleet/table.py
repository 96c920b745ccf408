"""A row for each drive: ``fleet.csv`` and ``fleet.parquet``."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from farpoint.fleet.drive import Drive
from farpoint.metrics.halves import evaluate_halves
from farpoint.sinks import read_run
from farpoint.sinks.files import replacing, text_output
from farpoint.sinks.halves import read_halves
from farpoint.sinks.positions import load_pyarrow
from farpoint.sinks.report.digest import digest_motions
from farpoint.trajectory.files import read_tum

__all__ = ["Row", "facts_of_run", "row_of", "write_tables"]

_MOMENTS = 3


@dataclass(frozen=True, kw_only=True)
class Row:
    """Row of a drive in the table.

    Attributes
    ----------
    drive, source, camera : str
        Name of the folder of the drive; source and calibration as given by the user.
    state : str
        ``done``, ``failed``, or ``waiting`` if the fleet was interrupted before the drive.
    frames : int or None
        Number of processed frames.
    duration_s, elapsed_s : float or None
        Duration of the drive, and duration of the computation, s.
    length : float or None
        Length of the path, in ``unit``.
    unit : str
        ``m`` with aiding measurements, otherwise the unit of the trajectory.
    ok, rotation_only, static, failed : int or None
        Number of pairs with each status.
    halves, halves_low, halves_high : float or None
        Split-half ratio, which is 1 for correct covariances, and the 95 % interval of the ratio for
        correct covariances.
    noise_px : float or None
        Median noise of a match, px.
    lens, lens_sigma : str
        Estimated parameters of the lens, and their 1-sigma.
    scale, scale_sigma : float or None
        Metres per unit of the trajectory, from the aiding measurements, and the relative 1-sigma of
        this scale.
    worst : str
        Worst moments, each with a time in s and a problem.
    error : str
        Reason of the failure, in one line.
    """

    drive: str
    source: str
    camera: str
    state: str
    frames: int | None = None
    duration_s: float | None = None
    elapsed_s: float | None = None
    length: float | None = None
    unit: str = ""
    ok: int | None = None
    rotation_only: int | None = None
    static: int | None = None
    failed: int | None = None
    halves: float | None = None
    halves_low: float | None = None
    halves_high: float | None = None
    noise_px: float | None = None
    lens: str = ""
    lens_sigma: str = ""
    scale: float | None = None
    scale_sigma: float | None = None
    worst: str = ""
    error: str = ""


def row_of(drive: Drive, facts: dict[str, Any] | None, error: str | None) -> Row:
    """The row of a drive, from the facts of its run or from an error.

    A drive without facts and without an error is ``waiting``.
    """
    what: dict[str, Any] = {"drive": drive.name, "source": drive.source, "camera": drive.camera}
    if facts is not None:
        return Row(**what, state="done", **facts)
    return Row(**what, state="waiting" if error is None else "failed", error=error or "")


def write_tables(out: Path, rows: Sequence[Row], parquet: bool) -> None:
    """Write ``fleet.csv``, and ``fleet.parquet`` if ``parquet`` is True."""
    names = [field.name for field in fields(Row)]
    lines = io.StringIO()
    writer = csv.DictWriter(lines, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    path = out / "fleet.csv"
    with replacing(path) as part, text_output(path, part) as write:
        write(lines.getvalue())
    if parquet:
        arrow, writing = load_pyarrow()
        kinds = {
            "str": arrow.string(),
            "int | None": arrow.int64(),
            "float | None": arrow.float64(),
        }
        schema = arrow.schema([(field.name, kinds[str(field.type)]) for field in fields(Row)])
        with replacing(out / "fleet.parquet") as part:
            table = arrow.Table.from_pylist([asdict(row) for row in rows], schema=schema)
            writing.write_table(table, str(part))


def facts_of_run(folder: Path) -> dict[str, Any]:
    """Facts for the row of a drive, collected by the worker that has written the outputs.

    Raises
    ------
    InputError, OSError, KeyError, TypeError, ValueError
        If the outputs cannot be read.
    """
    run = read_run(folder / "run.json")
    digest = digest_motions(folder / "motions.csv")
    moments = digest.moments.found({item["frame1"]: item["reason"] for item in run["reasons"]})
    metric = run.get("metric") or {}
    found, sigma = _lens(run)
    return {
        "frames": run["frames"],
        "duration_s": _number(digest.span_s),
        "elapsed_s": _number(run["wall_clock"]["elapsed_s"]),
        "length": _path_length(folder),
        "unit": "m" if metric.get("unit") == "m" else "trajectory",
        **{status.value.lower(): count for status, count in digest.counts.items()},
        **_honesty(folder),
        "noise_px": _median(digest, "noise_px"),
        "lens": found,
        "lens_sigma": sigma,
        "scale": _number(metric.get("metres_per_unit", {}).get("first")),
        "scale_sigma": _number(metric.get("relative_sigma")),
        "worst": "; ".join(f"{m.time_s:.1f} s: {m.title}" for m in moments[:_MOMENTS]),
    }


def _path_length(folder: Path) -> float | None:
    poses = read_tum(folder / "trajectory.tum")
    positions = poses.world_from_body[:, :3, 3]
    steps = positions[1:] - positions[:-1]
    return _number(float(((steps**2).sum(axis=1) ** 0.5).sum()))


def _honesty(folder: Path) -> dict[str, float | None]:
    file = folder / "halves.csv"
    if not file.is_file():
        return {}
    halves = read_halves(file)
    if not any(half.dof for half in halves):
        return {}
    ratio = evaluate_halves(halves).ratio
    return {
        "halves": _number(ratio.ratio),
        "halves_low": _number(ratio.low),
        "halves_high": _number(ratio.high),
    }


def _lens(run: dict[str, Any]) -> tuple[str, str]:
    """The estimated lens and its sigma, from the key ``lens``, or else from the key ``camera``."""
    lens = run.get("lens") or {}
    found = lens.get("found") or run["camera"].get("parameters")
    return _words(found), _words(lens.get("sigma") or run["camera"].get("sigma"))


def _words(parameters: Any) -> str:
    if isinstance(parameters, dict):
        return " ".join(f"{name}={value:.6g}" for name, value in parameters.items())
    if isinstance(parameters, list):
        return " ".join(f"{value:.6g}" for value in parameters)
    return ""


def _median(digest: Any, name: str) -> float | None:
    if name not in digest.series:
        return None
    values = sorted(v for v in digest.series[name].first.tolist() if math.isfinite(v))
    return values[len(values) // 2] if values else None


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
