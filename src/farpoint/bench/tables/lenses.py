"""The tables of lenses: times of unprojection, and odometry over images of wide lenses."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from farpoint.bench.cameras import CAMERAS
from farpoint.bench.interleaved import one_thread
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.rendered import (
    RENDERED_COLUMNS,
    RENDERED_NOTES,
    rendered_cells,
    run_rendered,
)
from farpoint.bench.table import Column, Table
from farpoint.camera import (
    Arctangent,
    CameraModel,
    Division,
    DoubleSphere,
    Equirectangular,
    ExtendedUnified,
    KannalaBrandt,
    Pinhole,
    Scaramuzza,
    Unified,
)
from farpoint.synthetic import RenderedSequence, street_drive

__all__ = ["unprojection_table", "wide_table"]

_PIXELS = 1_000_000
_REPEATS = 5
_SIZE = (1280, 960)
# Pairs of one street share most of their tracks, and with them their errors: many short drives.
_PAIRS = 40
_PAIRS_PER_STREET = 8
_FPS = 30.0

_CENTRE: dict[str, Any] = {"cx": 639.5, "cy": 479.5}
_RADTAN = (0.1, 0.05, 1e-4, 2e-5, 0.01, 0.12, 0.06, 0.012, 1e-3, 1e-4, 1e-3, 1e-4, 0.01, 0.01)
_LENSES: tuple[tuple[str, CameraModel], ...] = (
    *(
        (
            f"pinhole, {count} coefficients",
            Pinhole(fx=800.0, fy=800.0, **_CENTRE, distortion=_RADTAN[:count]),
        )
        for count in (0, 4, 5, 8, 12, 14)
    ),
    ("Kannala-Brandt", KannalaBrandt(fx=478.0, fy=478.0, **_CENTRE, k1=3.5e-3, k2=7e-4, k3=-2e-3)),
    ("unified", Unified(fx=700.0, fy=700.0, **_CENTRE, xi=1.2)),
    (
        "unified with distortion",
        Unified(fx=700.0, fy=700.0, **_CENTRE, xi=1.2, distortion=(-0.1, 0.02, 1e-4, 1e-4)),
    ),
    ("extended unified", ExtendedUnified(fx=460.0, fy=460.0, **_CENTRE, alpha=0.6, beta=1.05)),
    ("double sphere", DoubleSphere(fx=400.0, fy=400.0, **_CENTRE, xi=-0.17, alpha=0.59)),
    ("FOV", Arctangent(fx=600.0, fy=600.0, **_CENTRE, omega=0.9)),
    ("division", Division(fx=800.0, fy=800.0, **_CENTRE, k=-0.2)),
    (
        "Scaramuzza",
        Scaramuzza(coefficients=(-300.0, 0.0, 1e-3, -1e-6, 1e-9), **_CENTRE, c=1.0, d=0.0, e=0.0),
    ),
    ("equirectangular", Equirectangular(width=_SIZE[0], height=_SIZE[1])),
)


def unprojection_table(options: BenchOptions, progress: Progress) -> tuple[Table, ...]:
    """Time to unproject a million pixels, s, for every lens model."""
    rng = np.random.default_rng(options.seed)
    pixels = rng.uniform((0.0, 0.0), np.array(_SIZE) - 1.0, (_PIXELS, 2))
    rows = []
    for done, (name, model) in enumerate(_LENSES):
        progress("unprojection", done, len(_LENSES))
        with one_thread():
            rows.append((name, _fastest_s(lambda: model.unproject(pixels))))  # noqa: B023
    progress("unprojection", len(_LENSES), len(_LENSES))
    return (
        Table(
            name="unprojection",
            title="Time to unproject a million pixels, by lens model",
            command=options.command("lenses"),
            columns=(Column("lens"), Column("seconds", 3)),
            rows=tuple(rows),
            notes=(f"processor time, least of {_REPEATS} runs; {_SIZE[0]} x {_SIZE[1]} px",),
        ),
    )


def wide_table(options: BenchOptions, progress: Progress) -> tuple[Table, ...]:
    """A row for each wide camera, with drives through rendered streets."""
    pairs = options.pairs or _PAIRS
    streets = math.ceil(pairs / _PAIRS_PER_STREET)
    frames = min(pairs, _PAIRS_PER_STREET) + 1
    seeds = range(options.seed, options.seed + streets)
    rows = []
    for name, camera in CAMERAS.items():
        errors = run_rendered(
            *(
                RenderedSequence(camera, street_drive(frames, _FPS, seed), seed=seed)
                for seed in seeds
            ),
            progress=lambda done, total: progress(f"drive, {name}", done, total),  # noqa: B023
        )
        rows.append((name, *rendered_cells(errors)))
    return (
        Table(
            name="wide",
            title="Rendered drives through wide lenses, 30 frames a second",
            command=options.command("lenses"),
            columns=(Column("lens"), *RENDERED_COLUMNS),
            rows=tuple(rows),
            notes=(
                *RENDERED_NOTES,
                f"{frames - 1} pairs in each street, which share most of their tracks",
            ),
        ),
    )


def _fastest_s(call: Callable[[], object]) -> float:
    """Processor time, s, of the fastest of several calls. The first call compiles kernels."""
    call()
    seconds = []
    for _ in range(_REPEATS):
        start = time.process_time()
        call()
        seconds.append(time.process_time() - start)
    return min(seconds)
