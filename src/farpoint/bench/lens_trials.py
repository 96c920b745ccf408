"""Simulated recordings with a wrong calibration: errors of the estimated lens and of the path."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from farpoint.bench.path_samples import samples_of
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.metrics import PathSamples
from farpoint.odometry.lens_in_use import LensInUse
from farpoint.path.lens import LensEstimate, with_prior
from farpoint.path.options import LensRefinementOptions, PathOptions
from farpoint.path.path import Pair, PathBuilder
from farpoint.pose import PoseStatus, RelativePose, estimate_relative_pose
from farpoint.synthetic import HandheldTracks

__all__ = ["LensError", "LensTrial", "calibrated_wrong", "try_lens"]

LensError = Literal["drawn", "two sigmas"]
"""How a calibration is off: by a draw from its prior, or by two sigmas of the focal length."""

_FRAMES, _FPS = 45, 30.0
_DRAWS = 100  # largest number of draws until the parameters are valid


@dataclass(frozen=True, kw_only=True, eq=False)
class LensTrial:
    """Result of a simulated recording.

    Attributes
    ----------
    parameters : dict of str to float
        Errors of the estimated parameters of the lens model, each divided by its sigma.
    nees : float
        NEES of the lens, divided by the number of free directions in the space of the parameters.
    readout : float
        Error of the read-out time, divided by its sigma.
    path : PathSamples
        The final poses and the true poses.
    """

    parameters: dict[str, float]
    nees: float
    readout: float
    path: PathSamples


def calibrated_wrong(
    true: Camera, error: LensError, rng: np.random.Generator, prior: LensRefinementOptions
) -> Camera:
    """The camera with errors of the given kind in its calibration, and the prior's covariance."""
    prior_camera = with_prior(true.with_uncertainty(), prior)
    lens, factor = prior_camera.refinable, prior_camera.parameter_factor
    values = np.array(list(lens.parameters.values()))
    for _ in range(_DRAWS):
        if error == "drawn":
            change = factor @ rng.normal(size=factor.shape[1])
        else:
            by_scale = np.array([lens.roles.scale.get(name, 0.0) for name in lens.parameters])
            change = 2.0 * prior.focal_sigma * rng.choice([-1.0, 1.0]) * by_scale
        try:
            given = replace(true, model=lens.with_parameters(values + change), uncertainty=None)
        except InputError:  # invalid parameters
            continue
        return given.with_parameter_covariance(prior_camera.parameter_covariance())
    raise InputError(f"none of {_DRAWS} draws from the prior makes a lens", field="true")


def try_lens(
    true: Camera, error: LensError, *, seed: int, prior: LensRefinementOptions | None = None
) -> LensTrial:
    """Simulate a handheld recording with a wrong lens and an unknown read-out time."""
    prior = prior or LensRefinementOptions()
    rng = np.random.default_rng((seed, 9))
    given = calibrated_wrong(true, error, rng, prior)
    recording = HandheldTracks(
        camera=true,
        frames=_FRAMES,
        seed=seed,
        readout_s=float(rng.uniform(0.0, 1.0 / _FPS)),
        fps=_FPS,
    )
    motions = _Motions(given, prior)
    path = PathBuilder(motions.estimate, PathOptions(), prior)
    times = recording.timestamps.tolist()
    path.pass_over(0, times[0])
    points, poses = [path.now], []
    for k, tracks in enumerate(recording):
        seconds = times[k + 1] - times[k]
        motion = motions.estimate(tracks.points0, tracks.points1, tracks.covariance_px2, seconds)
        if motion.status is PoseStatus.FAILED:
            points.append(path.break_off())
            path.pass_over(k + 1, times[k + 1])
            continue
        pair = Pair(frame0=k, frame1=k + 1, time0=times[k], time1=times[k + 1])
        points.append(path.add(given, tracks, motion, pair))
        poses += path.final_poses()
        motions.update(path.lens)
    assert path.lens is not None  # the camera moves
    return LensTrial(
        parameters=_parameter_errors(true, path.lens),
        nees=_nees(true, path.lens),
        readout=_readout_error(recording.readout_s, path.lens),
        path=samples_of(
            [*poses, *path.remaining()],
            recording.world_from_cam,
            points,
            [max(k - 1, 0) for k in range(len(points))],
        ),
    )


class _Motions:
    """Two-view motions, estimated with the lens and the shutter that are in use.

    The given lens and shutter are in use until the estimates differ clearly from the given values.
    """

    def __init__(self, given: Camera, options: LensRefinementOptions) -> None:
        self._lens = LensInUse(given, options)

    def estimate(
        self, points0: np.ndarray, points1: np.ndarray, covariance_px2: np.ndarray, seconds: float
    ) -> RelativePose:
        """The motion from matches (N, 2), px, with the lens in use."""
        half_px2 = 0.5 * covariance_px2
        return estimate_relative_pose(
            points0,
            points1,
            self._lens.camera,
            covariance0_px2=half_px2,
            covariance1_px2=half_px2,
            interval_s=self._lens.interval_s(seconds),
        )

    def update(self, lens: LensEstimate | None) -> None:
        """Take over the path's estimate of the lens."""
        self._lens.update(lens)


def _parameter_errors(true: Camera, lens: LensEstimate) -> dict[str, float]:
    report = lens.report()
    found, right = report.camera.model.parameters, true.refinable.parameters
    return {
        name: (found[name] - right[name]) / sigma
        for name, sigma in report.sigma.items()
        if sigma > 0.0
    }


def _nees(true: Camera, lens: LensEstimate) -> float:
    right = np.array(list(true.refinable.parameters.values()))
    given = np.array(list(lens.given.refinable.parameters.values()))
    off = lens.z - np.linalg.pinv(lens.factor) @ (right - given)
    covariance = lens.covariance[: lens.size, : lens.size]
    return float(off @ np.linalg.solve(covariance, off)) / lens.size


def _readout_error(true_s: float, lens: LensEstimate) -> float:
    return (lens.readout_s - true_s) / float(np.sqrt(lens.covariance[-1, -1]))
