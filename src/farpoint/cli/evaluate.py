"""``farpoint evaluate``: whether a run's covariances hold, with truth or without."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from farpoint.errors import InputError
from farpoint.evaluate import EvaluationOptions, evaluate_folder, write_pairs
from farpoint.metrics import to_json, to_text
from farpoint.sinks.report import write_report

__all__ = ["Evaluate"]


@dataclass(frozen=True, kw_only=True)
class Evaluate:
    """Test the covariances of a run by halves of its matches, and compare it with true poses.

    Attributes
    ----------
    folder : Path
        Folder of a run.
    truth : Path or None
        TUM or KITTI trajectory, or EuRoC ground truth.
    json : bool
        Print JSON instead of a table.
    pairs : Path or None
        File for the errors pair by pair, CSV; needs the truth.
    report : bool
        Write ``report.html`` of the folder anew, with the true path beside the estimated one; needs
        the truth.
    options : EvaluationOptions
        What counts.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    truth: Path | None = None
    json: bool = False
    pairs: Path | None = None
    report: bool = False
    options: Annotated[EvaluationOptions, tyro.conf.arg(name="")] = field(
        default_factory=EvaluationOptions
    )

    def __call__(self) -> None:
        """Do it."""
        if self.pairs is not None and self.truth is None:
            raise InputError("errors pair by pair need --truth", field="--pairs")
        if self.report and self.truth is None:
            raise InputError("a true path in the report needs --truth", field="--report")
        found = evaluate_folder(self.folder, self.truth, self.options)
        if self.pairs is not None:
            write_pairs(self.pairs, found)
        if self.report:
            write_report(self.folder, self.truth)
        print(to_json(found.evaluation) if self.json else to_text(found.evaluation))
