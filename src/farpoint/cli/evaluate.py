"""``farpoint evaluate``: test of the covariances of a run, with or without true poses."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from farpoint.camera.files.extrinsics import read_body_from_cam
from farpoint.cli.run import warn
from farpoint.errors import InputError
from farpoint.evaluate import EvaluationOptions, evaluate_folder, write_pairs
from farpoint.metrics import to_json, to_text
from farpoint.sinks.report import write_report

__all__ = ["Evaluate"]


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Test the covariances of a run by halves of the matches, and compare the run with true poses.

    Attributes
    ----------
    folder : Path
        Folder of a run.
    truth : Path or None
        True poses: a TUM or KITTI trajectory, or EuRoC ground truth.
    body_from_camera : Path or None
        File with the pose of the camera relative to the body whose true poses are given: EuRoC's
        sensor.yaml (T_BS), a Kalibr camera chain (T_cam_imu), or 16 numbers. By default the true
        poses are those of the camera.
    json : bool
        Print JSON instead of a table.
    pairs : Path or None
        CSV file to write the errors of each pair into. This option needs truth.
    report : bool
        Write ``report.html`` of the folder again, with the true path. This option needs truth.
    options : EvaluationOptions
        Options of the comparison.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    truth: Path | None = None
    body_from_camera: Path | None = None
    json: bool = False
    pairs: Path | None = None
    report: bool = False
    options: Annotated[EvaluationOptions, tyro.conf.arg(name="")] = field(
        default_factory=EvaluationOptions
    )

    def __call__(self) -> None:
        """Run the command."""
        if self.pairs is not None and self.truth is None:
            raise InputError("errors pair by pair need --truth", field="--pairs")
        if self.report and self.truth is None:
            raise InputError("a true path in the report needs --truth", field="--report")
        if self.body_from_camera is not None and self.truth is None:
            raise InputError(
                "a body that the truth follows needs --truth", field="--body-from-camera"
            )
        body_from_cam = (
            None if self.body_from_camera is None else read_body_from_cam(self.body_from_camera)
        )
        found = evaluate_folder(self.folder, self.truth, self.options, body_from_cam=body_from_cam)
        if self.pairs is not None:
            write_pairs(self.pairs, found)
        if self.report:
            write_report(self.folder, self.truth)
        if self.json:
            print(to_json(found.evaluation))
            for note in found.notes:
                warn(note)
        else:
            print(to_text(found.evaluation))
            print(*found.notes, sep="\n", end="\n" if found.notes else "")
