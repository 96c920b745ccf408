"""Errors of lens and path, estimated from a wrong calibration, against the covariances."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from farpoint.bench.interleaved import one_thread
from farpoint.bench.lens_trials import LensError, LensTrial, try_lens
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.path_samples import joined
from farpoint.bench.table import Cell, Column, Table
from farpoint.camera import (
    Arctangent,
    Camera,
    CameraModel,
    Division,
    DoubleSphere,
    ExtendedUnified,
    KannalaBrandt,
    Pinhole,
    Scaramuzza,
    Unified,
)
from farpoint.metrics import chi2_quantile, evaluate_path

__all__ = ["lens_table"]

_RUNS = 7  # for each lens and each error: 63 for each error
_ERRORS: tuple[LensError, ...] = ("drawn", "two sigmas")
_SIZE = (640, 480)
_CENTRE: dict[str, Any] = {"cx": 319.5, "cy": 239.5}
_LENSES: tuple[tuple[str, CameraModel], ...] = (
    ("pinhole", Pinhole(fx=420.0, fy=420.0, **_CENTRE, distortion=(0.05, -0.08, 1e-3, -1e-3))),
    ("pinhole, 8 coefficients", Pinhole(fx=420.0, fy=420.0, **_CENTRE, distortion=(
        0.1, 0.05, 1e-4, 2e-5, 0.01, 0.12, 0.06, 0.012))),
    ("Kannala-Brandt", KannalaBrandt(fx=300.0, fy=300.0, **_CENTRE, k1=0.01, k2=-0.005)),
    ("unified", Unified(fx=450.0, fy=450.0, **_CENTRE, xi=0.8)),
    ("extended unified", ExtendedUnified(fx=280.0, fy=280.0, **_CENTRE, alpha=0.6, beta=1.05)),
    ("double sphere", DoubleSphere(fx=250.0, fy=250.0, **_CENTRE, xi=-0.2, alpha=0.6)),
    ("FOV", Arctangent(fx=300.0, fy=300.0, **_CENTRE, omega=0.9)),
    ("division", Division(fx=400.0, fy=400.0, **_CENTRE, k=-0.2)),
    (
        "Scaramuzza",
        Scaramuzza(coefficients=(-300.0, 0.0, 1e-3, -1e-6, 1e-9), **_CENTRE, c=1.0, d=0.0, e=0.0),
    ),
)  # fmt: skip
_COLUMNS = (
    Column("lens"),
    Column("error"),
    Column("runs"),
    Column("parameters_95", 2),
    Column("lens_nees", 2),
    Column("readout_95", 2),
    Column("readout_z_rms", 2),
    Column("segments"),
    Column("orientation_nees", 2),
    Column("position_nees", 2),
    Column("pose_nees", 2),
    Column("pose_low", 2),
    Column("pose_high", 2),
    Column("scale_nees", 2),
    Column("end_95", 2),
)


def lens_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """Rows for every lens and every calibration error, and two rows for all lenses together."""
    runs = options.pairs or _RUNS
    rows: list[tuple[Cell, ...]] = []
    together: dict[LensError, list[LensTrial]] = {error: [] for error in _ERRORS}
    for lens, (name, model) in enumerate(_LENSES):
        camera = Camera(model=model, size=_SIZE)
        for kind, error in enumerate(_ERRORS):
            trials = []
            for run in range(runs):
                progress(f"{name}, {error}", run, runs)
                # No two trials share their motion, points or noise.
                seed = options.seed + run + runs * (kind + len(_ERRORS) * lens)
                with one_thread():
                    trials.append(try_lens(camera, error, seed=seed))
            progress(f"{name}, {error}", runs, runs)
            together[error] += trials
            rows.append((name, error, *_cells(trials)))
        yield _table(rows, options)
    rows += [("all together", error, *_cells(trials)) for error, trials in together.items()]
    yield _table(rows, options)


def _cells(trials: Sequence[LensTrial]) -> tuple[Cell, ...]:
    z = np.abs([value for trial in trials for value in trial.parameters.values()])
    path = evaluate_path(joined([trial.path for trial in trials]))
    assert path is not None  # the camera moves
    return (
        len(trials),
        float(np.mean(z <= 1.96)),
        float(np.mean([trial.nees for trial in trials])),
        float(np.mean([abs(trial.readout) <= 1.96 for trial in trials])),
        float(np.sqrt(np.mean([trial.readout**2 for trial in trials]))),
        path.pose.segments,
        path.orientation.mean_nees,
        path.position.mean_nees,
        path.pose.mean_nees,
        path.pose.nees_low,
        path.pose.nees_high,
        path.scale.mean_nees,
        _ends_within(trials),
    )


def _ends_within(trials: Sequence[LensTrial]) -> float:
    """Share of the recordings in which the 95 % region of the last pose contains the truth."""
    ends = [path.pose.end_nees for trial in trials if (path := evaluate_path(trial.path))]
    return float(np.mean(np.array(ends) <= chi2_quantile(0.95, 6)))


def _table(rows: Sequence[tuple[Cell, ...]], options: BenchOptions) -> Table:
    return Table(
        name="lens",
        title="Handheld recordings with a wrong calibration: errors of the estimated lens and "
        "path over their sigmas",
        command=options.command("lens"),
        columns=_COLUMNS,
        rows=tuple(rows),
        notes=(
            "simulated tracks of 45 frames with a read-out time of 0 to 1 frame times; drawn: "
            "the error of the calibration is drawn from its prior; two sigmas: the error of the "
            "focal length is two sigmas, 6 %",
            "parameters_95: share of the model's parameters within 1.96 of their sigmas, 0.95 if "
            "honest; lens_nees: mean NEES of the lens over its number of parameters, 1 if honest",
            "readout_95: share of read-out times within 1.96 of their sigmas; readout_z_rms: root "
            "mean square error in its sigma, 1 if honest",
            "nees: of the final poses of the path, mean over the segments of the mean over their "
            "poses; 3, 3, 6 and 1 if honest; low, high: 95 % interval of such means, with one "
            "sample per segment; end_95: share of recordings whose last pose lies within its 95 "
            "% region",
        ),
    )
