"""All outputs of a run in one folder, opened together and closed together."""

from __future__ import annotations

import contextlib
import subprocess
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from farpoint.camera import write_camera
from farpoint.errors import InputError
from farpoint.metrics import SplitHalf
from farpoint.odometry import LensReport, Odometry, OdometryResult
from farpoint.options import coerce_int
from farpoint.sinks.files import new_of, part_of, replacing, unwritable
from farpoint.sinks.halves import HalvesFile
from farpoint.sinks.lens import lens_facts
from farpoint.sinks.lock import FolderLock
from farpoint.sinks.motions import MotionsFile
from farpoint.sinks.overlay import PALETTES, PaletteName, open_video, require_libraries
from farpoint.sinks.positions import PositionsFile, load_pyarrow, write_positions_parquet
from farpoint.sinks.report import REPORT_NAME, write_report
from farpoint.sinks.run_record import RunDescription, RunRecord, RunState
from farpoint.sinks.sink import PathFile, Posed, Sink
from farpoint.sinks.trajectory import KittiFile, TrajectoryFile

__all__ = ["OutputFolder", "OutputOptions"]

_PATH_FILES: dict[str, tuple[Callable[[Path], PathFile], str]] = {
    "trajectory": (TrajectoryFile, "trajectory.tum"),
    "kitti": (KittiFile, "trajectory.kitti"),
    "positions": (PositionsFile, "positions.csv"),
}
_MOTIONS_NAME, _CAMERA_NAME = "motions.csv", "camera.yaml"
_RECORD_NAME, _HALVES_NAME, _VIDEO_NAME = "run.json", "halves.csv", "overlay.mp4"
_OUTPUTS = (
    REPORT_NAME,
    _MOTIONS_NAME,
    *(file for _, file in _PATH_FILES.values()),
    _CAMERA_NAME,
    _HALVES_NAME,
    _VIDEO_NAME,
    "positions.parquet",
)


@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Options of the outputs; the text files are always written.

    Attributes
    ----------
    overlay : bool
        Write ``overlay.mp4`` in a separate process. Without the overlay the report has no pictures.
    report : bool
        Write ``report.html`` at the end.
    halves_every : int
        Interval, in pairs, between the pairs that are also estimated from two halves of their
        matches, for ``halves.csv``. With 0, no pair is estimated from halves.
    palette : {"red-green", "orange-blue"}
        Colours of far and near points in overlay and report. The colours of ``orange-blue`` are
        distinct with any colour vision.
    parquet : bool
        Write ``positions.parquet`` at the end, beside ``positions.csv``. This option needs pyarrow.
    """

    overlay: bool = True
    report: bool = True
    halves_every: int = 5
    palette: PaletteName = "red-green"
    parquet: bool = False

    def __post_init__(self) -> None:
        coerce_int(self, 0, "halves_every")
        if self.palette not in PALETTES:
            raise InputError(
                f"expected one of {', '.join(PALETTES)}, got {self.palette!r}", field="palette"
            )


class OutputFolder:
    """All files of a run: motions, trajectory, split-half tests, overlay, record and report.

    An object of this class is a context manager. The end of the ``with`` block sets the state of
    the run: done, interrupted by Ctrl-C, or failed with the message of the error. The state is also
    failed if an output cannot be finished. The files are valid in all states. The folder is locked
    until the end of the block.

    Parameters
    ----------
    folder : str or Path
        Output folder, created if necessary. Outputs of an earlier run in the folder are replaced.
    run : RunDescription
        Description of the run.
    options : OutputOptions, optional
    video_process : Popen, optional
        Process that draws the overlay, from an earlier call of `start_video_process`.
    lock : FolderLock, optional
        Lock of the folder, if the caller has locked the folder and will release the lock.

    Raises
    ------
    InputError
        If the folder or a file in the folder cannot be written, or if another run is writing into
        the folder.
    MissingExtraError
        If an output needs a library that is not installed.

    Attributes
    ----------
    path : Path
        The folder.
    notes : tuple of str
        Warnings about the folder, such as a file system without locks.
    """

    def __init__(
        self,
        folder: str | Path,
        run: RunDescription,
        options: OutputOptions | None = None,
        video_process: subprocess.Popen[bytes] | None = None,
        lock: FolderLock | None = None,
    ) -> None:
        self.path = Path(folder)
        self._options = options or OutputOptions()
        self._closed = False
        self._last_steps: list[Callable[[Path], object]] = []
        self._pairs, self._last_frame = 0, -1
        # Missing libraries raise an error before hours of work and before earlier outputs are
        # removed.
        if self._options.parquet:
            load_pyarrow()
        if self._options.overlay:
            require_libraries()
        with ExitStack() as opened:
            lock = lock or opened.enter_context(FolderLock(self.path))
            self.notes = () if lock.note is None else (lock.note,)
            run = replace(run, notes=(*run.notes, *self.notes))
            self._record = RunRecord(self.path / _RECORD_NAME, run)
            opened.callback(self._record.close)
            try:
                self._record.reserve_room()
                _remove_outputs(self.path)
                self._open_sinks(run, video_process)
            except BaseException as error:
                with contextlib.suppress(InputError):  # the error that ended the run matters more
                    self._record.finish(*_verdict(error))
                raise
            self._open_outputs = opened.pop_all()

    def _open_sinks(
        self, run: RunDescription, video_process: subprocess.Popen[bytes] | None
    ) -> None:
        self._sinks: dict[str, Sink] = {}
        self._path_files: dict[str, PathFile] = {}
        self._halves: HalvesFile | None = None
        with ExitStack() as opened:  # if a file cannot be opened, the files before are closed
            self._sinks["motions"] = MotionsFile(self.path / _MOTIONS_NAME)
            opened.callback(self._sinks["motions"].close)
            for name, (kind, file) in _PATH_FILES.items():
                self._path_files[name] = kind(self.path / file)
                opened.callback(self._path_files[name].close)
            if self._options.halves_every:
                self._halves = HalvesFile(self.path / _HALVES_NAME)
                opened.callback(self._halves.close)
            if self._options.overlay:
                video = self.path / _VIDEO_NAME
                self._sinks["overlay"] = open_video(
                    video, run.camera, self._options.palette, video_process, run.mask
                )
            opened.pop_all()

    def add(self, name: str, sink: Sink) -> None:
        """Add a sink that gets all results and is closed together with the other outputs."""
        self._sinks[name] = sink

    def at_end(self, step: Callable[[Path], object]) -> None:
        """Call ``step`` with the folder when the text files of the run are complete."""
        self._last_steps.append(step)

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Add the result of one frame to every output; neither argument may change later."""
        for name, sink in self._sinks.items():
            start = time.perf_counter()
            sink.write(result, image)
            self._record.add_time(name, time.perf_counter() - start)
        self._last_frame = result.frame1
        self._record.write(result, image)

    def write_final_poses(self, poses: Iterable[Posed]) -> None:
        """Add final poses of the path: `Odometry.final_poses`, or at the end `Odometry.remaining`.

        Poses of frames whose result was not written because of Ctrl-C are left out.
        """
        for pose in poses:
            if pose.frame1 > self._last_frame:
                break
            for name, file in self._path_files.items():
                start = time.perf_counter()
                file.write(pose)
                self._record.add_time(name, time.perf_counter() - start)

    def finish_path(self, odometry: Odometry) -> None:
        """Write the end of a run in any state: the last poses, lens and notes."""
        self.write_final_poses(odometry.remaining())
        self.write_lens_and_notes(odometry)

    def write_lens_and_notes(self, odometry: Odometry) -> None:
        """Write the estimated lens, times and notes."""
        if odometry.camera.size is not None:
            self.put_lens(odometry.lens)
        for stage, seconds in odometry.seconds.items():
            self.add_time(stage, seconds)
        for note in odometry.notes:
            self.note(note)

    def put_lens(self, lens: LensReport) -> None:
        """Write the estimates of lens and shutter to ``run.json`` and ``camera.yaml``."""
        self._record.put("lens", lens_facts(lens))
        with replacing(self.path / _CAMERA_NAME) as part:
            write_camera(lens.camera, part)

    def check_halves(self, result: OdometryResult, odometry: Odometry) -> None:
        """Run the split-half test of the last pair, if the options request it for this pair."""
        every = self._options.halves_every
        if result.pose is None or not every:
            return
        self._pairs += 1
        if (self._pairs - 1) % every == 0:
            start = time.perf_counter()
            self.write_halves(result, odometry.split_half(result))
            self.add_time("halves", time.perf_counter() - start)

    def write_halves(self, result: OdometryResult, halves: SplitHalf) -> None:
        """Add the split-half test of one pair, if the options ask for such tests."""
        if self._halves is not None:
            self._halves.write(result, halves)

    def put(self, name: str, fact: object) -> None:
        """Set a key of ``run.json``."""
        self._record.put(name, fact)

    def note(self, words: str) -> None:
        """Add a note about the results to ``run.json``."""
        self._record.note(words)

    def add_time(self, stage: str, seconds: float) -> None:
        """Add seconds to the time of a stage outside of this class, such as reading images."""
        self._record.add_time(stage, seconds)

    def close(self, state: RunState = RunState.DONE, error: str | None = None) -> None:
        """Finish every output, even if another output fails. A second call does nothing.

        Raises
        ------
        BaseException
            The first error that occurred. A second Ctrl-C counts as an error.
        """
        if self._closed:
            return
        self._closed = True
        with self._open_outputs:
            problems = [problem for step in self._last_of_all() if (problem := _attempt(step))]
            state, error = _with_problems(state, error, problems)
            problems += filter(None, [_attempt(partial(self._record.finish, state, error))])
            if self._options.report and (problem := _attempt(partial(write_report, self.path))):
                problems.append(problem)
                state, error = _with_problems(state, error, [problem])
                _attempt(partial(self._record.finish, state, error))
        if problems:
            raise problems[0]

    def _last_of_all(self) -> list[Callable[[], object]]:
        """Steps that finish every output except the record and the report, which come last."""
        steps: list[Callable[[], object]] = [sink.close for sink in self._sinks.values()]
        steps += [file.close for file in self._path_files.values()]
        if self._halves is not None:
            steps.append(self._halves.close)
        steps += [partial(step, self.path) for step in self._last_steps]
        if self._options.parquet:
            steps.append(partial(write_positions_parquet, self.path))
        return steps

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            self.close()
            return
        try:
            self.close(*_verdict(error))
        except Exception as problem:  # the error that ended the run matters more
            error.add_note(f"and while closing the outputs: {_one_line(problem)}")


def _remove_outputs(folder: Path) -> None:
    """Remove the outputs of an earlier run."""
    for name in _OUTPUTS:
        path = folder / name
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise unwritable(path, error) from error
        for unfinished in (part_of(path), new_of(path)):
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)


def _attempt(step: Callable[[], object]) -> BaseException | None:
    try:
        step()
    except BaseException as problem:
        return problem
    return None


def _verdict(error: BaseException) -> tuple[RunState, str | None]:
    """State and message of a run that ended with an error."""
    if isinstance(error, KeyboardInterrupt):
        return RunState.INTERRUPTED, None
    return RunState.FAILED, _one_line(error)


def _with_problems(
    state: RunState, error: str | None, problems: list[BaseException]
) -> tuple[RunState, str | None]:
    """State and message of a run, changed by errors of outputs that could not be finished.

    A KeyboardInterrupt among ``problems`` changes neither the state nor the message.
    """
    problem = next((problem for problem in problems if isinstance(problem, Exception)), None)
    if problem is None or error is not None:
        return state, error
    return RunState.FAILED if state is RunState.DONE else state, _one_line(problem)


def _one_line(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())
