"""The sink ``run.json``: source, options, versions, statuses and timing of the run."""

from __future__ import annotations

import importlib
import json
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

import farpoint
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus
from farpoint.sinks.files import replacing
from farpoint.sinks.plain import plain
from farpoint.sinks.reserve import Reserve

__all__ = ["RunDescription", "RunRecord", "RunState", "read_run"]

WALL_CLOCK = "wall_clock"
"""The one key whose contents differ from run to run."""

_LIBRARIES = ("numpy", "scipy", "numba", "cv2", "av")
_UPDATE_S = 1.0  # least time between two updates of the file during the run
_MAX_REASONS = 100  # reasons stored for each status other than OK; the counts have no limit


class RunState(Enum):
    """State of a run. The values are the words in ``run.json``."""

    RUNNING = "running"
    """Running, or killed before the final state was written."""
    DONE = "done"
    """The source was read to its end."""
    INTERRUPTED = "interrupted"
    """Stopped by the user; the files are valid up to the interruption."""
    FAILED = "failed"
    """Stopped by an error; the files are valid up to the error."""


@dataclass(frozen=True, kw_only=True)
class RunDescription:
    """Description of a run, known before its first frame.

    Attributes
    ----------
    source : str
        Source as given by the user: a path, a camera index or a URL.
    source_name : str
        Short name, for titles.
    camera : Camera
        The calibration. The image size may still be unknown.
    options : mapping of str to object
        Effective options of each stage: dataclasses or plain values.
    frame_count : int or None
        Number of frames of the source; None if unknown.
    timestamp_source : str
        Origin of the time stamps.
    notes : tuple of str
        Notes about the results, one sentence each.
    mask : ndarray of bool, shape (H, W), or None
        True where the frames are used; None if the whole frames are used.
    """

    source: str
    source_name: str
    camera: Camera
    options: Mapping[str, object]
    frame_count: int | None = None
    timestamp_source: str = ""
    notes: tuple[str, ...] = ()
    mask: np.ndarray | None = None


class RunRecord:
    """Counts frames and pairs, and updates ``run.json`` by replacing the whole file.

    A repeated run gives the same file, except for the key ``wall_clock``.

    Parameters
    ----------
    path : Path
        The file; an existing file is replaced.
    run : RunDescription
        Description of the run.

    Raises
    ------
    InputError
        If the file cannot be written.
    """

    def __init__(self, path: Path, run: RunDescription) -> None:
        self._path = path
        self._reserve: Reserve | None = None
        self._run = run
        self._camera = run.camera
        self._state = RunState.RUNNING
        self._error: str | None = None
        self._frames = self._without_image = 0
        self._first_s: float | None = None
        self._last_s: float | None = None
        self._counts = dict.fromkeys(PoseStatus, 0)
        self._reasons: list[dict[str, Any]] = []
        self._guesses: list[dict[str, Any]] = []
        self._guess_count = 0
        self._stages_s: dict[str, float] = {}
        self._facts: dict[str, Any] = {}
        self._started = datetime.now(UTC)
        self._clock_start = self._clock_saved = time.monotonic()
        self._fixed = {
            "versions": _versions(),
            "source": {
                "given": run.source,
                "name": run.source_name,
                "frames": run.frame_count,
                "timestamps": run.timestamp_source,
            },
            "options": plain(run.options),
            "notes": list(run.notes),
        }
        self._save()

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Count one frame; update the file if the last update is old enough."""
        self._frames += 1
        self._first_s = result.timestamp if self._first_s is None else self._first_s
        self._last_s = result.timestamp
        if image is None:
            self._without_image += 1
        elif self._camera.size is None:
            self._camera = self._camera.with_size(image.shape[1], image.shape[0])
        if result.pose is not None:
            self._count(result)
        if result.scale_is_guessed:
            self._guess_count += 1
            if self._guess_count <= _MAX_REASONS:
                self._guesses.append({"frame": result.frame1, "timestamp": result.timestamp})
        if time.monotonic() - self._clock_saved > _UPDATE_S:
            self._save()

    def note(self, words: str) -> None:
        """Add a note about the results."""
        self._fixed["notes"].append(words)

    def add_time(self, stage: str, seconds: float) -> None:
        """Add to the time spent in a stage of the run."""
        self._stages_s[stage] = self._stages_s.get(stage, 0.0) + seconds

    def put(self, name: str, fact: object) -> None:
        """Set a key of ``run.json``; an earlier value is replaced."""
        self._facts[name] = plain(fact)

    def reserve_room(self) -> None:
        """Reserve disk space until `close`, so that `finish` works on a full disk.

        Raises
        ------
        InputError
            If the disk has too little free space.
        """
        self._reserve = Reserve(self._path)

    def finish(self, state: RunState, error: str | None = None) -> None:
        """Write the final state of the run; `error` is the reason of a failure, in one line."""
        self._state, self._error = state, error
        try:
            self._save()
        except InputError:
            if self._reserve is None or not self._reserve.replace(self._text()):
                raise

    def close(self) -> None:
        """Free the reserved space; `finish` writes the final state of the run."""
        if self._reserve is not None:
            self._reserve.release()

    def _count(self, result: OdometryResult) -> None:
        pose = result.pose
        assert pose is not None
        self._counts[pose.status] += 1
        for stage in ("search", "refinement", "covariance"):
            self.add_time(stage, getattr(pose.stats, f"{stage}_s"))
        if pose.status is not PoseStatus.OK and self._counts[pose.status] <= _MAX_REASONS:
            self._reasons.append(
                {
                    "frame0": int(result.frame0),
                    "frame1": int(result.frame1),
                    "timestamp0": float(result.timestamp0),
                    "timestamp1": float(result.timestamp),
                    "status": pose.status.value,
                    "reason": pose.reason,
                }
            )

    def _save(self) -> None:
        self._clock_saved = time.monotonic()
        with replacing(self._path) as part:
            part.write_text(self._text(), encoding="utf-8", newline="\n")

    def _text(self) -> str:
        return json.dumps(self._contents(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"

    def _contents(self) -> dict[str, Any]:
        elapsed_s = self._clock_saved - self._clock_start
        camera = self._camera
        not_ok = sum(self._counts.values()) - self._counts[PoseStatus.OK]
        return {
            "state": self._state.value,
            "error": self._error,
            **self._fixed,
            "camera": {
                "name": camera.name,
                "file": camera.source,
                "model": camera.model.title,
                "size": None if camera.size is None else list(camera.size),
                "parameters": plain(camera.model.parameters),
            },
            "frames": self._frames,
            "frames_without_image": self._without_image,
            "first_timestamp": self._first_s,
            "last_timestamp": self._last_s,
            "pairs": {status.value: count for status, count in self._counts.items()},
            "reasons": self._reasons,
            "reasons_omitted": not_ok - len(self._reasons),
            "scale_guesses": self._guess_count,
            "scale_guessed_at": self._guesses,
            **self._facts,
            WALL_CLOCK: {
                "started": self._started.isoformat(timespec="seconds"),
                "elapsed_s": round(elapsed_s, 3),
                "frames_per_s": round(self._frames / elapsed_s, 2) if elapsed_s > 0.0 else None,
                "stages_s": {name: round(value, 4) for name, value in self._stages_s.items()},
            },
        }


def read_run(path: Path) -> dict[str, Any]:
    """Read a ``run.json``.

    Raises
    ------
    InputError
        If the file cannot be read or is not the record of a run.
    """
    try:
        run = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
    except ValueError as error:
        raise InputError("expected JSON as farpoint writes it", file=path) from error
    for key in ("state", "source", "camera", "options", "versions", "notes", "reasons"):
        if not isinstance(run, dict) or key not in run:
            raise InputError("missing: expected the record of a run", file=path, field=key)
    return run


def _versions() -> dict[str, str | None]:
    versions: dict[str, str | None] = {
        "farpoint": farpoint.__version__,
        "python": platform.python_version(),
    }
    for name in _LIBRARIES:
        try:
            versions[name] = importlib.import_module(name).__version__
        except ImportError:
            versions[name] = None
    return versions
