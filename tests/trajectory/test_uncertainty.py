"""The covariance along a path is that of errors drawn as it supposes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drive_kit import cloud, forward, motion_of, poses_of
from scipy.stats import chi2

from farpoint.geometry import so3, sphere
from farpoint.trajectory.chain import chain
from farpoint.trajectory.scale import ScaleFit
from farpoint.trajectory.uncertainty import (
    PersistentShares,
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


def drawn_path(motions, shares: PersistentShares, rng: np.random.Generator) -> np.ndarray:
    """Error (7,) at the end of a path whose motions err as the shares say."""
    true, found = np.eye(4), np.eye(4)
    persistent, scale_error = rng.normal(size=7), 0.0
    share = np.array([shares.length, *[shares.motion] * 5])
    for k, motion in enumerate(motions):
        fit = length_fit(k, motion)
        moves = k < STEPS - TURNS
        sigma = np.sqrt(np.diag(fit.covariance))
        mean_beta = np.sqrt(np.mean(sigma[4:] ** 2))
        own = np.linalg.cholesky(fit.covariance) @ rng.normal(size=6)
        common = np.concatenate(
            [
                sigma[:4] * persistent[:4],
                mean_beta * motion.direction_basis.T @ persistent[4:],
            ]
        )
        error = np.sqrt(1.0 - share) * own + np.sqrt(share) * common
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


@pytest.mark.parametrize(("motion", "length"), [(0.0, 0.0), (0.15, 0.02), (0.6, 0.5)])
def test_the_covariance_is_that_of_what_it_supposes(motions, motion, length):
    shares = PersistentShares(motion=motion, length=length)
    covariance, pose = covariance_at_rest(), np.eye(4)
    for k, one in enumerate(motions):
        if k < STEPS - TURNS:
            fit = length_fit(k, one)
            covariance = advance_moving(covariance, pose, one, fit, shares)
            pose = chain(pose, one, fit.scale)
        else:
            covariance = advance_turning(covariance, pose, one, shares)
            pose = chain(pose, one, None)
    rng = np.random.default_rng(1)
    errors = np.array([drawn_path(motions, shares, rng) for _ in range(400)])
    claimed = covariance[:7, :7]
    for part in (slice(0, 3), slice(3, 6), slice(6, 7), slice(0, 7)):
        rows = errors[:, part]
        nees = np.sum(rows * np.linalg.solve(claimed[part, part], rows.T).T, axis=1)
        dof = rows.shape[1]
        low, high = chi2.ppf([0.0005, 0.9995], dof * len(nees)) / len(nees)
        assert low < nees.mean() < high, part


def test_errors_that_persist_add_up_in_step(motions):
    grown = []
    for share in (0.0, 0.15):
        covariance, pose = covariance_at_rest(), np.eye(4)
        for _ in range(50):
            covariance = advance_turning(
                covariance, pose, motions[0], PersistentShares(motion=share, length=0.0)
            )
        grown.append(np.trace(covariance[:3, :3]))
    # Variance of a sum of n errors that correlate by r: n (1 + (n - 1) r) times that of one.
    assert grown[1] / grown[0] == pytest.approx(1.0 + 49.0 * 0.15, rel=0.35)
