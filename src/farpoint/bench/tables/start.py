"""Time of the first estimate of a new process, before and after the kernels are compiled."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile

import numpy as np

from farpoint.bench.estimators.estimator import pinhole_points
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.table import Cell, Column, Table
from farpoint.bench.views import views_of_scene
from farpoint.synthetic import make_point_scene, paper_example

__all__ = ["start_table"]

_WARM_STARTS = 3
# Run by a new interpreter. The clock starts before the first import. No other code that numba
# compiles, or loads from its cache, runs before the estimate.
_SCRIPT = """
import time
started = time.perf_counter()
import farpoint
imported = time.perf_counter()
import json, sys
import numpy as np
camera, matches = json.load(sys.stdin)
farpoint.estimate_relative_pose(*np.array(matches), farpoint.Camera.pinhole(*camera))
print(json.dumps([imported - started, time.perf_counter() - imported]))
"""
_COLUMNS = (
    Column("start"),
    Column("import_s", 2),
    Column("first_estimate_s", 2),
    Column("total_s", 2),
)


def start_table(options: BenchOptions, progress: Progress) -> tuple[Table, ...]:
    """Seconds to import farpoint and to compute the first estimate, in new processes."""
    count = 1 + _WARM_STARTS
    times_s = []
    with tempfile.TemporaryDirectory(prefix="farpoint-bench-") as cache:
        for done in range(count):
            progress("start", done, count)
            times_s.append(_start(cache))
    progress("start", count, count)
    warm = np.median(times_s[1:], axis=0)
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (name, float(seconds[0]), float(seconds[1]), float(sum(seconds)))
        for name, seconds in (("cold", times_s[0]), ("warm", warm))
    )
    return (
        Table(
            name="start",
            title="A fresh process: seconds to import farpoint and to its first estimate",
            command=options.command("time"),
            columns=_COLUMNS,
            rows=rows,
            notes=(
                "cold: numba's cache is empty, so every kernel is compiled; "
                f"warm: the cache is filled, median of {_WARM_STARTS} starts",
            ),
        ),
    )


def _start(cache: str) -> tuple[float, float]:
    """Times, s, of import and first estimate in a process whose numba cache is ``cache``."""
    scene = make_point_scene(paper_example(outliers=20), seed=0)
    seen = pinhole_points(views_of_scene(scene))
    camera = *(scene.camera.size or ()), *seen.focal_px, *seen.centre_px
    matches = seen.points0.tolist(), seen.points1.tolist()
    done = subprocess.run(
        [sys.executable, "-c", _SCRIPT],
        input=json.dumps([camera, matches]),
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    imported_s, estimated_s = json.loads(done.stdout)
    return imported_s, estimated_s
