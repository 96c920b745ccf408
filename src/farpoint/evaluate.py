"""Evaluation of a folder of ``farpoint run``: by split halves, and by a file of true poses."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.metrics import (
    PAIR_COLUMNS,
    AssociationOptions,
    Evaluation,
    HalvesEvaluation,
    PairErrors,
    PathSamples,
    TrajectoryEvaluation,
    evaluate_halves,
    evaluate_motions,
    evaluate_path,
    evaluate_stretches,
    evaluate_trajectory,
    pair_errors,
    pair_rows,
    poses_at_frames,
    poses_at_times,
    relative_motions,
)
from farpoint.metrics.other_frame import fits_better, other_frame
from farpoint.options import coerce_float, coerce_int
from farpoint.sinks.files import replacing
from farpoint.sinks.halves import read_halves
from farpoint.sinks.motions import Motions, read_motions
from farpoint.sinks.positions import read_positions
from farpoint.trajectory.files import (
    QuaternionOrder,
    Trajectory,
    iter_tum,
    named_order,
    read_trajectory,
)

__all__ = ["EvaluationOptions", "FolderEvaluation", "evaluate_folder", "write_pairs"]

MIN_POSES = 3


@dataclass(frozen=True, kw_only=True)
class EvaluationOptions:
    """Options of the comparison of a run with the truth.

    Attributes
    ----------
    min_translation : float
        Least true translation for which the error of the direction is computed, in the unit of the
        truth.
    delta_frames : int
        Number of frames over which relative pose errors are computed.
    truth_quaternion : {"xyzw", "wxyz"} or None
        Order of the quaternions in the file of true poses. By default the names of the columns, if
        the file has names, give the order. Otherwise w is first in EuRoC files and last in TUM
        files.
    association : AssociationOptions
        Interpolation of true poses at the times of the estimates.
    """

    truth_quaternion: QuaternionOrder | None = None
    min_translation: float = 0.01
    delta_frames: int = 1
    association: AssociationOptions = field(default_factory=AssociationOptions)

    def __post_init__(self) -> None:
        coerce_float(self, "a length, 0 or more", lambda length: length >= 0, "min_translation")
        coerce_int(self, 1, "delta_frames")


@dataclass(frozen=True, kw_only=True, eq=False)
class FolderEvaluation:
    """Result of `evaluate_folder`.

    Attributes
    ----------
    evaluation : Evaluation
        Figures of the run, which `farpoint.metrics.to_text` and `to_json` write.
    errors : PairErrors
        Errors of the motion in each row of ``motions.csv``; NaN without truth.
    motions : Motions
        The rows of ``motions.csv``.
    notes : tuple of str
        Notes on how the true poses were read, and warnings if other camera axes or another order of
        the quaternions fit better.
    """

    evaluation: Evaluation
    errors: PairErrors
    motions: Motions
    notes: tuple[str, ...] = ()


def evaluate_folder(
    folder: str | Path,
    truth: str | Path | None = None,
    options: EvaluationOptions | None = None,
    *,
    body_from_cam: np.ndarray | None = None,
) -> FolderEvaluation:
    """Test the covariances of a run by ``halves.csv`` in its folder, and by true poses if given.

    ``motions.csv``, ``trajectory.tum`` and ``positions.csv`` are compared with the truth. Without
    ``positions.csv`` the result has no figures of the path covariance. Truth with time stamps (TUM,
    EuRoC) is interpolated at the times of the run. Truth without time stamps (KITTI) has one pose
    per frame of the source.

    Parameters
    ----------
    folder : str or Path
        Output folder of ``farpoint run``.
    truth : str or Path, optional
        TUM, KITTI or EuRoC trajectory of true poses. Without a trajectory, only the split-half test
        is evaluated.
    options : EvaluationOptions, optional
        Options of the comparison.
    body_from_cam : ndarray, shape (4, 4), optional
        Pose of the camera on the body whose poses the truth contains (EuRoC: ``T_BS``). By default
        the body is the camera.

    Raises
    ------
    InputError
        If a file is missing or malformed, or estimates and truth have no frame or time in common.
    """
    options = options or EvaluationOptions()
    folder = Path(folder)
    motions_file = folder / "motions.csv"
    motions = read_motions(motions_file)
    if not len(motions):
        raise InputError("expected at least one pair of frames", file=motions_file)
    halves = _evaluated_halves(folder / "halves.csv")
    reference, notes = None, ()
    if truth is not None:
        reference = _of_camera(read_trajectory(truth, options.truth_quaternion), body_from_cam)
        notes = _notes(Path(truth), motions, reference, body_from_cam, options)
    try:
        errors = _motion_errors(motions, reference, options)
    except InputError as error:
        in_motions = truth is None or str(error.field).startswith("covariances")
        where = motions_file if in_motions else truth
        raise InputError(error.problem, file=where, field=error.field) from error
    trajectory, fault, samples = None, None, None
    if reference is not None:
        with _naming(folder / "positions.csv") as file:
            samples = _path_samples(file, motions, reference, options)
        with _naming(folder / "trajectory.tum") as file:
            trajectory, fault = _evaluated_trajectory(file, motions, reference, options)
    evaluation = Evaluation(
        motions=evaluate_motions(errors),
        trajectory=trajectory,
        trajectory_fault=fault,
        path=None if samples is None else evaluate_path(samples),
        stretches=() if samples is None else evaluate_stretches(samples),
        halves=halves,
    )
    return FolderEvaluation(evaluation=evaluation, errors=errors, motions=motions, notes=notes)


def write_pairs(path: str | Path, found: FolderEvaluation) -> None:
    """Write errors as CSV: columns ``timestamp0,timestamp1,frame0,frame1`` and `PAIR_COLUMNS`."""
    m = found.motions
    keys = zip(m.timestamp0, m.timestamp1, m.frame0, m.frame1, strict=True)
    with replacing(Path(path)) as part, part.open("w", encoding="utf-8", newline="\n") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("timestamp0", "timestamp1", "frame0", "frame1", *PAIR_COLUMNS))
        for (time0, time1, frame0, frame1), row in zip(keys, pair_rows(found.errors), strict=True):
            writer.writerow((repr(float(time0)), repr(float(time1)), frame0, frame1, *row))


def _of_camera(truth: Trajectory, body_from_cam: np.ndarray | None) -> Trajectory:
    if body_from_cam is None:
        return truth
    return Trajectory(
        timestamps=truth.timestamps, world_from_body=truth.world_from_body @ body_from_cam
    )


def _notes(
    file: Path,
    motions: Motions,
    truth: Trajectory,
    body_from_cam: np.ndarray | None,
    options: EvaluationOptions,
) -> tuple[str, ...]:
    """Notes on how the truth was read, and warnings if other axes or orders fit better."""
    order = options.truth_quaternion or named_order(file)
    source = "as given" if options.truth_quaternion else "by the names of its columns"
    of = "the camera" if body_from_cam is None else "a body that carries the camera"
    notes = [f"true poses are taken for those of {of}, world_from_body"]
    if truth.timestamps is not None:
        words = f"{' '.join(order)} ({source})" if order else "in the order of the format (assumed)"
        notes.append(f"true quaternions are {words}")
    estimated = motions.rotation_cam1_from_cam0
    true = _true_rotations(motions, truth, options)
    if (found := other_frame(estimated, true)) is not None:
        cause = (
            "The truth may be of another body than the camera; --body-from-camera FILE takes its "
            "place on that body"
            if body_from_cam is None
            else "--body-from-camera may be of another camera, or the other way round"
        )
        degrees = np.rad2deg(so3.log(found.true_from_camera))
        notes.append(
            "hint: relative rotations agree only after a constant rotation of the axes, by the "
            f"rotation vector ({degrees[0]:.1f}, {degrees[1]:.1f}, {degrees[2]:.1f}) deg: "
            f"{np.rad2deg(found.with_rad):.3f} deg rms instead of "
            f"{np.rad2deg(found.without_rad):.3f}. {cause}"
        )
    inverse = replace(truth, world_from_body=np.linalg.inv(truth.world_from_body))
    if fits_better(estimated, true, _true_rotations(motions, inverse, options)):
        notes.append("hint: the inverse poses, cam_from_world, agree far better with the run")
    if truth.timestamps is not None:
        other = "xyzw" if (order or "xyzw") == "wxyz" else "wxyz"
        with suppress(InputError):
            swapped = _of_camera(read_trajectory(file, other), body_from_cam)
            if fits_better(estimated, true, _true_rotations(motions, swapped, options)):
                notes.append(
                    f"hint: quaternions in the order {other} agree far better with the run"
                )
    return tuple(notes)


def _true_rotations(motions: Motions, truth: Trajectory, options: EvaluationOptions) -> np.ndarray:
    """Relative rotations (N, 3, 3) of the pairs, NaN where unknown."""
    times = np.concatenate([motions.timestamp0, motions.timestamp1])
    frames = np.concatenate([motions.frame0, motions.frame1])
    try:
        poses = _true_poses(truth, times, frames, options)
    except InputError:
        return np.full((len(motions), 3, 3), np.nan)
    return relative_motions(*np.split(poses, 2))[0]


def _true_poses(
    truth: Trajectory, timestamps: np.ndarray, frames: np.ndarray, options: EvaluationOptions
) -> np.ndarray:
    if truth.timestamps is None:
        return poses_at_frames(truth.world_from_body, frames)
    return poses_at_times(truth.timestamps, truth.world_from_body, timestamps, options.association)


@contextmanager
def _naming(file: Path) -> Iterator[Path]:
    """Add the name of the file to an InputError that names no file."""
    try:
        yield file
    except InputError as error:
        if error.file is not None:
            raise
        raise InputError(error.problem, file=file, field=error.field) from error


def _evaluated_halves(path: Path) -> HalvesEvaluation | None:
    """Figures of the split-half tests; None if the run made no tests."""
    if not path.exists():
        return None
    with _naming(path):
        halves = read_halves(path)
        return evaluate_halves(halves) if halves else None


def _motion_errors(
    motions: Motions, truth: Trajectory | None, options: EvaluationOptions
) -> PairErrors:
    poses = np.full((2 * len(motions), 4, 4), np.nan)
    if truth is not None:
        poses = _true_poses(
            truth,
            np.concatenate([motions.timestamp0, motions.timestamp1]),
            np.concatenate([motions.frame0, motions.frame1]),
            options,
        )
    true_rotations, true_translations = relative_motions(*np.split(poses, 2))
    return pair_errors(
        statuses=list(motions.status),
        rotations=motions.rotation_cam1_from_cam0,
        directions=motions.direction_cam1_from_cam0,
        covariances=motions.covariance,
        true_rotations=true_rotations,
        true_translations=true_translations,
        min_translation=options.min_translation,
        direction_bases=motions.direction_basis,
    )


def _evaluated_trajectory(
    file: Path, motions: Motions, truth: Trajectory, options: EvaluationOptions
) -> tuple[TrajectoryEvaluation | None, str | None]:
    """Figures of the trajectory, or the reason for their absence, such as a camera at rest."""
    rows = list(iter_tum(file, whole_lines=True))
    if not rows:  # of a run that was killed early
        return None, f"{file.name} holds no pose"
    timestamps = np.array([stamp for stamp, _ in rows])
    estimate = np.stack([pose for _, pose in rows])
    poses = _true_poses(truth, timestamps, _frames_at(timestamps, motions), options)
    known = ~np.isnan(poses[:, 0, 0])
    count = int(np.count_nonzero(known))
    if count < max(MIN_POSES, options.delta_frames + 1):
        return None, f"only {count} poses have a true one"
    try:
        return evaluate_trajectory(
            estimate[known], poses[known], delta_frames=options.delta_frames
        ), None
    except InputError as error:
        return None, error.problem


def _path_samples(
    file: Path, motions: Motions, truth: Trajectory, options: EvaluationOptions
) -> PathSamples | None:
    """The path with its covariances; None if the run wrote no poses to ``positions.csv``."""
    if not file.exists() or not len(positions := read_positions(file)):
        return None
    row_of = {int(frame): row for row, frame in enumerate(positions.frames)}
    pairs = [k for k, frame in enumerate(motions.frame1) if int(frame) in row_of]
    ends = [row_of[int(motions.frame1[k])] for k in pairs]
    lengths, sigmas = np.full((2, len(positions)), np.nan)
    lengths[ends], sigmas[ends] = motions.scale[pairs], motions.scale_sigma[pairs]
    begins = np.arange(len(positions))
    begins[ends] = [row_of.get(int(frame), 0) for frame in motions.frame0[pairs]]
    return PathSamples(
        segments=positions.segments,
        world_from_cam=positions.world_from_cam,
        covariances=positions.covariances,
        truth=_true_poses(truth, positions.timestamps, positions.frames, options),
        lengths=lengths,
        length_sigmas=sigmas,
        length_from=begins,
    )


def _frames_at(timestamps: np.ndarray, motions: Motions) -> np.ndarray:
    """Frame numbers of time stamps, from the pairs of the run; -1 for a time stamp in no pair."""
    frame_of = dict(zip(motions.timestamp0, motions.frame0, strict=True))
    frame_of |= dict(zip(motions.timestamp1, motions.frame1, strict=True))
    return np.array([frame_of.get(stamp, -1) for stamp in timestamps])
