"""Paths whose errors grow from pose to pose exactly as their covariances say."""

from __future__ import annotations

import numpy as np

from farpoint.geometry import so3
from farpoint.metrics import PathSamples

TURN_SIGMA, SIDE_SIGMA, SCALE_SIGMA = 2e-3, 5e-3, 4e-3
"""Of each motion: rad, share of its length, and of the logarithm of the scale."""

METRES = 3.0  # in a unit of the first segment


def _true_steps(count: int, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    turns = rng.normal(0.0, 0.05, (count, 3))
    steps = rng.normal([0.0, 0.0, 1.0], 0.1, (count, 3))
    return [(so3.exp(turn), METRES * step) for turn, step in zip(turns, steps, strict=True)]


def _moved(pose: np.ndarray, turn: np.ndarray, step: np.ndarray) -> np.ndarray:
    after = np.eye(4)
    after[:3, :3] = pose[:3, :3] @ turn
    after[:3, 3] = pose[:3, 3] + pose[:3, :3] @ step
    return after


def drawn_path(
    segments: int = 12, count: int = 40, *, seed: int = 0, starts_at_row: bool = True
) -> PathSamples:
    """Segments of ``count`` motions each, the truth in another world, in metres.

    With ``starts_at_row`` a segment begins at a row of its own, of zero covariance, as after a cut;
    otherwise at the last row of the segment before.
    """
    rng = np.random.default_rng(seed)
    true, found = _moved(np.eye(4), so3.exp([0.3, -1.0, 0.2]), np.array([5.0, 1.0, 2.0])), np.eye(4)
    rows: list[tuple] = []
    for segment in range(segments):
        if starts_at_row or not segment:
            rows.append((segment, found, np.zeros((7, 7)), true, np.nan, np.nan))
        covariance, scale_error, unit = np.zeros((7, 7)), 0.0, None
        for turn, step in _true_steps(count, rng):
            length = np.linalg.norm(step)
            first, unit = unit is None, length if unit is None else unit
            guess = step / unit
            own = 0.0 if first else SCALE_SIGMA
            scale_error += own * rng.normal()
            side = rng.normal(0.0, SIDE_SIGMA, 3)
            side -= (side @ guess) * guess / (guess @ guess)
            turned = turn @ so3.exp(rng.normal(0.0, TURN_SIGMA, 3))
            guess = np.linalg.norm(guess) * (guess / np.linalg.norm(guess) + side)
            true = _moved(true, turn, step)
            before, found = found, _moved(found, turned, np.exp(scale_error) * guess)
            covariance = _grown(covariance, found[:3, 3] - before[:3, 3], own)
            found_length = np.exp(scale_error) * length / unit
            sigma = found_length * np.sqrt(covariance[6, 6])
            rows.append((segment, found, covariance, true, found_length, sigma))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return PathSamples(
        segments=columns[0],
        world_from_cam=columns[1],
        covariances=columns[2],
        truth=columns[3],
        lengths=columns[4],
        length_sigmas=columns[5],
        length_from=np.maximum(np.arange(len(rows)) - 1, 0),
    )


def _grown(covariance: np.ndarray, way: np.ndarray, own: float) -> np.ndarray:
    """Covariance after a motion along ``way``, world axes, whose scale errs anew by ``own``."""
    by_pose = np.eye(7)
    by_pose[3:6, :3], by_pose[3:6, 6] = -so3.skew(way), way
    length = np.linalg.norm(way)
    across = np.eye(3) - np.outer(way, way) / length**2
    after = by_pose @ covariance @ by_pose.T
    after[:3, :3] += TURN_SIGMA**2 * np.eye(3)
    after[3:6, 3:6] += (SIDE_SIGMA * length) ** 2 * across
    along = np.concatenate([np.zeros(3), way, [1.0]])
    return after + own**2 * np.outer(along, along)
