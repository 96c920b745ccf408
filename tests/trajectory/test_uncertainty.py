"""The covariance along a path is that of errors drawn as it supposes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drive_kit import cloud, forward, motion_of, poses_of
from scipy.linalg import block_diag, sqrtm
from scipy.stats import chi2

from farpoint.geometry import so3, sphere
from farpoint.path.chain import chain
from farpoint.trajectory.depths import BENDS
from farpoint.trajectory.moved import Moved
from farpoint.trajectory.scale import ScaleFit
from farpoint.trajectory.uncertainty import (
    SharedErrors,
    advance_moving,
    advance_turning,
    condense,
    covariance_at_rest,
    length_variance_shared,
)

STEPS, TURNS = 12, 3
GAIN = 0.6


@pytest.fixture(scope="module")
def motions():
    """Motions in a curve, with covariances of their own."""
    turns = np.random.default_rng(0).normal(0.0, 0.05, (STEPS, 3))
    found = []
    for k, tracks in enumerate(cloud(poses_of(forward(STEPS), turns), noise_px=0.3).tracks()):
        motion = motion_of(tracks)
        root = 1e-3 * np.random.default_rng(k).normal(size=(5, 5)) + 2e-3 * np.eye(5)
        found.append(
            replace(motion, covariance=root @ root.T, rotation_covariance=(root @ root.T)[:3, :3])
        )
    return found


def moved(k: int, motion) -> Moved:
    """A length whose distances err together, and have corrected half of the motion's variance."""
    rng = np.random.default_rng((k, 1))
    joint = np.zeros((6, 6))
    joint[0, 0] = (0.004 + 0.002 * (k % 3)) ** 2
    joint[1:, 1:] = 0.5 * motion.covariance
    fit = ScaleFit(
        scale=0.5 + 0.1 * k,
        correction=np.zeros(5),
        covariance=joint,
        gain=GAIN,
        ids=np.arange(9),
        by_inverse=np.zeros((6, 9)),
    )
    inherited = 1e-3 * rng.normal(size=(6, BENDS))
    return Moved(
        direction=motion.direction_cam1_from_cam0,
        parallax=None,
        fit=fit,
        inherited=inherited,
        is_resected=k % 4 == 1,
    )


def axes_after(k: int) -> np.ndarray:
    """Those of the errors of distances that are kept after a motion."""
    square = np.random.default_rng((k, 2)).normal(size=(BENDS + 6, BENDS + 6))
    return np.linalg.qr(square).Q[:, :BENDS]


def shared_error(motion, white: np.ndarray, *, moves: bool) -> np.ndarray:
    """What white errors (6,) make of a motion's ``[dtheta, dbeta]``, with its own correlations."""
    if not moves:
        return np.array([*np.real(sqrtm(motion.rotation_covariance)) @ white[:3], 0.0, 0.0])
    C, basis = motion.covariance, motion.direction_basis
    sigma = np.sqrt(np.repeat([np.trace(C[:3, :3]) / 3.0, np.trace(C[3:, 3:]) / 2.0], 3))
    axes = block_diag(np.eye(3), basis)
    # The plane's normal carries no error: lifted off 0 for the root alone.
    lifted = axes @ C @ axes.T / np.outer(sigma, sigma) + 1e-12 * np.eye(6)
    return axes.T @ (sigma * (np.real(sqrtm(lifted)) @ white))


def drawn_path(motions, shared: SharedErrors, rng: np.random.Generator) -> np.ndarray:
    """Error (7,) at the end of a path whose motions err as the shares say."""
    true, found = np.eye(4), np.eye(4)
    persistent, fading, scale_error = rng.normal(size=7), rng.normal(size=6), 0.0
    bends = rng.normal(size=BENDS)
    alone = 1.0 - shared.persistent_motion - shared.fading_motion
    left = np.array([1.0 - shared.persistent_length, *[alone] * 5])
    kept = np.exp(-1.0 / shared.fading_motions)
    for k, motion in enumerate(motions):
        step, moves = moved(k, motion), k < STEPS - TURNS
        fit, own = step.fit, rng.normal(size=6)
        corrected = np.array(
            [0.0, *np.linalg.cholesky(0.5 * motion.covariance) @ rng.normal(size=5)]
        )
        if not moves:
            own[1:], corrected[1:] = 0.0, np.sqrt(2.0) * corrected[1:]
        error = np.sqrt(left) * (fit.root @ own + corrected)
        error[0] += np.sqrt(shared.persistent_length * fit.covariance[0, 0]) * persistent[0]
        for share, white in (
            (shared.persistent_motion, persistent[1:]),
            (shared.fading_motion, fading),
        ):
            error[1:] += np.sqrt(share) * shared_error(motion, white, moves=moves)
        fading = kept * fading + np.sqrt(1.0 - kept**2) * rng.normal(size=6)
        if moves and step.is_resected:
            error[1:] += step.inherited[1:] @ bends
        truth = replace(
            motion,
            rotation_cam1_from_cam0=so3.exp(error[1:4]) @ motion.rotation_cam1_from_cam0,
            direction_cam1_from_cam0=sphere.retract(
                motion.direction_cam1_from_cam0, motion.direction_basis, error[4:]
            ),
        )
        if moves:
            scale_error += step.inherited[0] @ bends
            length = fit.scale * np.exp(scale_error + error[0])
            scale_error += GAIN * error[0]
            bends = axes_after(k).T @ np.concatenate([bends, own])
        true = chain(true, truth, length if moves else None)
        found = chain(found, motion, fit.scale if moves else None)
    turned = so3.log(true[:3, :3] @ found[:3, :3].T)
    return np.concatenate([turned, true[:3, 3] - found[:3, 3], [scale_error]])


@pytest.mark.parametrize(
    ("motion", "length", "fading", "motions_kept"),
    [(0.0, 0.0, 0.0, 1.0), (0.2, 0.02, 0.3, 12.0), (0.6, 0.5, 0.0, 1.0), (0.0, 0.0, 0.9, 4.0)],
)
def test_the_covariance_is_that_of_what_it_supposes(motions, motion, length, fading, motions_kept):
    shared = SharedErrors(
        persistent_motion=motion,
        persistent_length=length,
        fading_motion=fading,
        fading_motions=motions_kept,
    )
    covariance, pose = covariance_at_rest(), np.eye(4)
    for k, one in enumerate(motions):
        if k < STEPS - TURNS:
            step = moved(k, one)
            covariance = advance_moving(covariance, pose, one, step, shared)
            covariance = condense(covariance, axes_after(k))
            pose = chain(pose, one, step.fit.scale)
        else:
            covariance = advance_turning(covariance, pose, one, shared)
            pose = chain(pose, one, None)
    rng = np.random.default_rng(1)
    errors = np.array([drawn_path(motions, shared, rng) for _ in range(400)])
    claimed = covariance[:7, :7]
    for part in (slice(0, 3), slice(3, 6), slice(6, 7), slice(0, 7)):
        rows = errors[:, part]
        nees = np.sum(rows * np.linalg.solve(claimed[part, part], rows.T).T, axis=1)
        dof = rows.shape[1]
        low, high = chi2.ppf([0.0005, 0.9995], dof * len(nees)) / len(nees)
        assert low < nees.mean() < high, part


def test_what_a_length_shares_with_the_next_ones_is_the_error_of_the_scale(motions):
    shared = SharedErrors(
        persistent_motion=0.2, persistent_length=0.02, fading_motion=0.3, fading_motions=12.0
    )
    covariance = covariance_at_rest()
    for k in range(3):
        covariance = condense(
            advance_moving(covariance, np.eye(4), motions[k], moved(k, motions[k]), shared),
            axes_after(k),
        )
    step = moved(3, motions[3])
    step = replace(step, fit=replace(step.fit, gain=0.0))  # whose own error nothing takes over
    after = advance_moving(covariance, np.eye(4), motions[3], step, shared)
    assert length_variance_shared(covariance, step) == pytest.approx(after[6, 6], rel=1e-9)
    assert length_variance_shared(covariance, step) > 1.01 * covariance[6, 6]


def turned_by(motion, count: int, shared: SharedErrors) -> float:
    """Variance of the orientation after a number of equal turns."""
    covariance, pose = covariance_at_rest(), np.eye(4)
    motion = replace(motion, rotation_cam1_from_cam0=np.eye(3))
    for _ in range(count):
        covariance = advance_turning(covariance, pose, motion, shared)
    return float(np.trace(covariance[:3, :3]))


def test_errors_that_persist_add_up_in_step(motions):
    alone, persistent, fading = (
        SharedErrors(
            persistent_motion=a, persistent_length=0.0, fading_motion=b, fading_motions=5.0
        )
        for a, b in ((0.0, 0.0), (0.15, 0.0), (0.0, 0.15))
    )
    one = turned_by(motions[0], 50, alone)
    # Variance of a sum of n errors that correlate by r: n (1 + (n - 1) r) times that of one.
    grown = turned_by(motions[0], 50, persistent) / one
    assert grown == pytest.approx(1.0 + 49.0 * 0.15, rel=1e-9)
    # Of errors that forget each other, by k^m over m motions.
    lags = np.arange(1, 50)
    expected = 1.0 + 2.0 * 0.15 * np.sum((1.0 - lags / 50.0) * np.exp(-lags / 5.0))
    assert turned_by(motions[0], 50, fading) / one == pytest.approx(expected, rel=1e-9)
