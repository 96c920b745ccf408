"""Mutants of a run's own files: evaluated, or refused in one line that names the file."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from cli_kit import CommandLine, write_folder

from farpoint.errors import InputError
from farpoint.evaluate import evaluate_folder
from farpoint.metrics import to_json, to_text
from farpoint.synthetic.sequence import RenderedSequence
from farpoint.trajectory.files import Trajectory, write_tum
from fuzz import fuzz_count, mutant


@pytest.fixture
def run(
    farpoint: CommandLine,
    tmp_path: Path,
    calibration: Path,
    images: tuple[np.ndarray, ...],
    drive: RenderedSequence,
) -> Path:
    shots, out = write_folder(tmp_path / "shots", images[:8]), tmp_path / "out"
    quick = ("--no-overlay", "--no-report", "--halves-every", "1")
    assert farpoint("run", shots, "--camera", calibration, "--out", out, *quick).code == 0
    poses = np.array(drive.world_from_cam)[:8]
    write_tum(
        tmp_path / "truth.tum", Trajectory(timestamps=np.arange(8) / 10, world_from_body=poses)
    )
    return out


def outcome(out: Path) -> str:
    try:
        found = evaluate_folder(out, out.parent / "truth.tum")
        to_text(found.evaluation)
        to_json(found.evaluation)
    except InputError as error:
        return str(error)
    return "evaluated"


def test_mutants_are_evaluated_or_refused_in_one_line(run: Path):
    rng = random.Random(5)
    assert outcome(run) == "evaluated"
    for name in ("motions.csv", "halves.csv", "positions.csv", "trajectory.tum"):
        sample = (run / name).read_text()
        for _ in range(fuzz_count(40)):
            data = mutant(sample, rng)
            (run / name).write_bytes(data)
            said = outcome(run)
            assert said.isprintable(), data
            assert said == "evaluated" or str(run) in said or "truth.tum" in said, (said, data)
        (run / name).write_text(sample)
