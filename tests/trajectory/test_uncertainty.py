"""The covariance along a path is that of errors drawn as it supposes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drive_kit import cloud, forward, motion_of, poses_of
from scipy.linalg import block_diag, sqrtm
from scipy.stats import chi2

from farpoint.geometry import so3, sphere
from farpoint.trajectory.chain import chain
from farpoint.trajectory.scale import ScaleFit
from farpoint.trajectory.uncertainty import (
    SharedErrors,
    advance_moving,
    advance_turning,
    covariance_at_rest,
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


def length_fit(k: int, motion) -> ScaleFit:
    joint = np.zeros((6, 6))
    joint[0, 0] = (0.004 + 0.002 * (k % 3)) ** 2
    joint[1:, 1:] = motion.covariance
    return ScaleFit(
        scale=0.5 + 0.1 * k, correction=np.zeros(5), covariance=joint, gain=GAIN, points=9
    )


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
    alone = 1.0 - shared.persistent_motion - shared.fading_motion
    left = np.array([1.0 - shared.persistent_length, *[alone] * 5])
    kept = np.exp(-1.0 / shared.fading_motions)
    for k, motion in enumerate(motions):
        fit = length_fit(k, motion)
        moves = k < STEPS - TURNS
        error = np.sqrt(left) * (np.linalg.cholesky(fit.covariance) @ rng.normal(size=6))
        error[0] += np.sqrt(shared.persistent_length * fit.covariance[0, 0]) * persistent[0]
        for share, white in (
            (shared.persistent_motion, persistent[1:]),
            (shared.fading_motion, fading),
        ):
            error[1:] += np.sqrt(share) * shared_error(motion, white, moves=moves)
        fading = kept * fading + np.sqrt(1.0 - kept**2) * rng.normal(size=6)
        truth = replace(
            motion,
            rotation_cam1_from_cam0=so3.exp(error[1:4]) @ motion.rotation_cam1_from_cam0,
            direction_cam1_from_cam0=sphere.retract(
                motion.direction_cam1_from_cam0, motion.direction_basis, error[4:]
            ),
        )
        if moves:
            length = fit.scale * np.exp(scale_error + error[0])
            scale_error += GAIN * error[0]
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
            fit = length_fit(k, one)
            covariance = advance_moving(covariance, pose, one, fit, shared)
            pose = chain(pose, one, fit.scale)
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
