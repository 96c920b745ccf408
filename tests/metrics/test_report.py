"""The figures of a run as text, JSON and rows say what the records hold."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest

from farpoint.geometry import so3, sphere
from farpoint.metrics import (
    PAIR_COLUMNS,
    Evaluation,
    PairErrors,
    chi2_quantile,
    evaluate_motions,
    evaluate_trajectory,
    pair_errors,
    pair_rows,
    to_json,
    to_text,
)
from farpoint.pose import PoseStatus

TURN_RAD = 0.01
SWERVE_RAD = 0.2


def errors(min_translation: float = 0.5) -> PairErrors:
    """Four pairs: one with known errors, one flipped, one too short, one lost."""
    straight = np.array([0.0, 0.0, 1.0])
    swerved = np.array([np.sin(SWERVE_RAD), 0.0, np.cos(SWERVE_RAD)])
    covariances = np.tile(np.diag([TURN_RAD**2] * 3 + [SWERVE_RAD**2] * 2), (4, 1, 1))
    covariances[3] = np.nan
    rotations = np.tile(np.eye(3), (4, 1, 1))
    rotations[3] = np.nan
    return pair_errors(
        statuses=[PoseStatus.OK, PoseStatus.OK, PoseStatus.OK, PoseStatus.FAILED],
        rotations=rotations,
        directions=np.array([straight, straight, straight, [np.nan] * 3]),
        covariances=covariances,
        true_rotations=so3.exp(np.tile([0.0, TURN_RAD, 0.0], (4, 1))),
        true_translations=np.array([2.0 * swerved, -straight, 0.1 * straight, straight]),
        min_translation=min_translation,
    )


def trajectory(count: int = 300) -> tuple[np.ndarray, np.ndarray]:
    angle = np.linspace(0.0, 1.5, count)
    truth = np.tile(np.eye(4), (count, 1, 1))
    truth[:, :3, :3] = so3.exp(np.outer(angle, [0.0, 1.0, 0.0]))
    truth[:, 0, 3] = 100.0 * (1.0 - np.cos(angle))
    truth[:, 2, 3] = 100.0 * np.sin(angle)
    estimate = truth.copy()
    estimate[:, :3, 3] /= 4.0
    return estimate, truth


@pytest.fixture
def evaluation() -> Evaluation:
    return Evaluation(
        motions=evaluate_motions(errors()), trajectory=evaluate_trajectory(*trajectory())
    )


def test_the_figures_themselves(evaluation: Evaluation):
    motions = evaluation.motions
    assert motions.rotation_rad.median == pytest.approx(TURN_RAD)
    assert motions.rotation_rad.count == 3
    assert motions.direction_rad.count == 2
    assert motions.direction_rad.max == pytest.approx(np.pi)
    assert motions.directions_opposed == 1
    assert motions.directions_not_counted == 1
    assert motions.rotation.median_nees == pytest.approx(1.0)
    assert motions.rotation.median_sigma == pytest.approx(np.sqrt(3.0) * TURN_RAD)
    assert motions.rotation.sigma_over_error == pytest.approx(np.sqrt(chi2_quantile(0.5, 3)))
    assert evaluation.trajectory is not None
    assert evaluation.trajectory.scale == pytest.approx(4.0)
    assert evaluation.trajectory.ate_sim3.rmse < 1e-9


def test_text_tells_counts_figures_and_what_was_left_out(evaluation: Evaluation):
    text = to_text(evaluation)
    assert "pairs 4 (4 with truth)   OK 3   ROTATION_ONLY 0   STATIC 0   FAILED 1" in text
    assert "direction not counted for 1 pairs: true translation below 0.5" in text
    assert "direction 90 deg or more off for 1 pairs" in text
    rotation = next(line for line in text.splitlines() if line.startswith("rotation, deg"))
    assert rotation.split()[2:] == ["3", *["0.573"] * 5]
    assert "300 poses, true path 150.000, scale 4" in text
    assert "KITTI segments" in text
    assert max(len(line) for line in text.splitlines()) <= 140


def test_columns_are_aligned(evaluation: Evaluation):
    lines = to_text(evaluation).splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("error"))
    assert len({len(line) for line in lines[head : head + 3]}) == 1


def test_text_tells_why_there_is_no_trajectory(evaluation: Evaluation):
    text = to_text(replace(evaluation, trajectory=None, trajectory_fault="positions lie on a line"))
    assert "trajectory not compared: positions lie on a line" in text
    assert "ATE" not in text


def test_json_holds_the_record_and_null_for_infinity(evaluation: Evaluation):
    record = json.loads(to_json(evaluation))
    assert record["motions"]["statuses"]["OK"] == 3
    assert record["motions"]["rotation_rad"]["rmse"] == evaluation.motions.rotation_rad.rmse
    assert record["motions"]["pose"]["mean_nees"] is None
    assert record["motions"]["pose"]["coverage95"]["inside"] == 1
    assert record["trajectory"]["segments"][-1]["length"] is None


def test_rows_are_one_a_pair_under_their_columns():
    found = errors()
    file = io.StringIO()
    csv.writer(file).writerows([PAIR_COLUMNS, *pair_rows(found)])
    file.seek(0)
    rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["OK", "OK", "OK", "FAILED"]
    assert float(rows[0]["direction_error_deg"]) == pytest.approx(np.degrees(SWERVE_RAD))
    assert float(rows[0]["dtheta_y_rad"]) == pytest.approx(TURN_RAD)
    basis = sphere.tangent_basis(np.array([0.0, 0.0, 1.0]))
    dbeta = np.array([float(rows[0]["dbeta_0_rad"]), float(rows[0]["dbeta_1_rad"])])
    np.testing.assert_allclose(basis @ dbeta, [np.tan(SWERVE_RAD), 0.0, 0.0], atol=1e-8)
    assert rows[1]["pose_nees"] == "inf"
    assert rows[2]["direction_error_deg"] == ""
    assert rows[3]["rotation_error_deg"] == ""
