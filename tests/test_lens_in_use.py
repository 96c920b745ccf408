"""Lens and shutter that motions are estimated with: as given, until the path finds others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from farpoint.camera import Camera
from farpoint.geometry import so3
from farpoint.metrics import chi2_quantile
from farpoint.odometry import Odometry
from farpoint.odometry.lens_in_use import LensInUse
from farpoint.path.lens import LensEstimate, with_prior
from farpoint.path.options import LensRefinementOptions
from farpoint.synthetic import Miscalibration, render_drive

CAMERA = Camera.pinhole(640, 480, 500.0, 500.0, 319.5, 239.5)
INTERVAL_S = 1.0 / 30.0


def found_of(camera: Camera, *, focal: float, sigma: float, readout_s: float) -> LensEstimate:
    """An estimate whose focal length is off by some of its prior sigmas, all known to ``sigma``."""
    lens = LensEstimate(camera, LensRefinementOptions(), INTERVAL_S)
    direction = np.argmax(np.abs(lens.factor[0]))
    lens.z = focal * np.eye(lens.size)[direction]
    lens.readout_s = readout_s
    lens.covariance = np.diag([sigma**2] * lens.size + [0.001**2])
    return lens


@pytest.mark.parametrize("camera", [CAMERA, CAMERA.with_uncertainty(focal=0.03)])
def test_a_lens_is_taken_where_it_is_plainly_another(camera):
    in_use = LensInUse(camera, LensRefinementOptions())
    in_use.update(found_of(camera, focal=0.1, sigma=1.0, readout_s=0.0))
    assert in_use.camera.model == camera.model
    found = found_of(camera, focal=1.0, sigma=0.01, readout_s=0.0)
    in_use.update(found)
    assert in_use.camera.model == found.found().model
    assert in_use.camera.model != camera.model


@pytest.mark.parametrize("camera", [CAMERA, CAMERA.with_uncertainty(focal=0.03)])
def test_an_adopted_lens_is_as_uncertain_as_the_estimate(camera):
    in_use = LensInUse(camera, LensRefinementOptions())
    found = found_of(camera, focal=1.0, sigma=0.01, readout_s=0.0)
    in_use.update(found)
    prior = with_prior(camera, LensRefinementOptions()).parameter_sigmas()["fx"]
    assert in_use.camera.parameter_sigmas()["fx"] == pytest.approx(0.01 * prior, rel=1e-2)
    # A later estimate, two of its sigmas away, is not adopted: its difference is an uncertainty.
    found.z, found.covariance = 1.02 * found.z, found.covariance.copy()
    in_use.update(found)
    sigma = in_use.camera.parameter_sigmas()["fx"]
    assert sigma == pytest.approx(np.hypot(0.01, 0.02) * prior, rel=1e-2)


def test_an_exact_lens_stays_exact_until_another_is_adopted():
    in_use = LensInUse(CAMERA, LensRefinementOptions())
    in_use.update(found_of(CAMERA, focal=0.1, sigma=1.0, readout_s=0.0))
    assert in_use.camera.uncertainty is None
    given = CAMERA.with_uncertainty(focal=0.03)
    uncertain = LensInUse(given, LensRefinementOptions())
    uncertain.update(found_of(given, focal=0.1, sigma=0.5, readout_s=0.0))
    prior = given.parameter_sigmas()["fx"]
    sigma = uncertain.camera.parameter_sigmas()["fx"]
    assert sigma == pytest.approx(np.hypot(0.5, 0.1) * prior, rel=1e-2)


def test_sigmas_of_a_wrong_focal_length_are_part_of_all_covariances_of_a_drive():
    """Without the sigmas, 0.53 of the rotations are in their 95 % regions, with them 0.96."""
    inside = []
    for seed in range(1, 5):
        camera = Camera.pinhole(320, 240, 250.0, 250.0, 159.5, 119.5).with_readout(0.0)
        drive = render_drive(camera, frames=25, fps=10.0, seed=seed)
        frames = list(drive)
        for share in (0.02, -0.02):
            given = Miscalibration(focal_share=share).of(camera).with_uncertainty(focal=0.02)
            for result in Odometry(given).run(frames):
                if result.frame1 > 8:
                    true = drive.cam1_from_cam0(result.frame0, result.frame1)
                    error = so3.log(result.pose.rotation_cam1_from_cam0 @ true[:3, :3].T)
                    square = error @ np.linalg.solve(result.pose.rotation_covariance, error)
                    inside.append(square < chi2_quantile(0.95, 3))
    assert len(inside) == 128
    assert np.mean(inside) > 0.88  # the sampling error, 1 sigma, is 0.02


def test_a_shutter_is_global_until_its_read_out_stands_out():
    in_use = LensInUse(CAMERA, LensRefinementOptions())
    assert in_use.interval_s(INTERVAL_S) is None
    in_use.begin(INTERVAL_S)
    assert in_use.camera.readout_s == 0.0
    assert in_use.camera.readout_sigma_s == pytest.approx(0.5 * INTERVAL_S)
    assert in_use.interval_s(INTERVAL_S) == INTERVAL_S
    in_use.update(found_of(CAMERA, focal=0.0, sigma=1.0, readout_s=0.002))
    assert in_use.camera.readout_s == 0.0
    assert in_use.camera.readout_sigma_s == pytest.approx(np.hypot(0.002, 0.001))
    in_use.update(found_of(CAMERA, focal=0.0, sigma=1.0, readout_s=0.02))
    assert (in_use.camera.readout_s, in_use.camera.readout_sigma_s) == pytest.approx((0.02, 0.001))
    assert in_use.interval_s(INTERVAL_S) == INTERVAL_S
    # A frame is not read for longer than until the next one: its time stamp is off.
    assert in_use.interval_s(0.01) == pytest.approx(0.02)
    assert in_use.interval_s(0.0) is None


@pytest.mark.parametrize(
    ("camera", "options"),
    [
        (CAMERA.with_readout(0.01), LensRefinementOptions()),
        (CAMERA, LensRefinementOptions(readout_ms=10.0)),
    ],
)
def test_a_read_out_that_was_given_stays(camera, options):
    in_use = LensInUse(camera, options)
    in_use.begin(INTERVAL_S)
    in_use.update(found_of(replace(camera, readout_s=None), focal=0.0, sigma=1.0, readout_s=0.02))
    assert in_use.camera.readout_s == pytest.approx(0.01)


def test_an_unknown_shutter_is_global_if_nothing_is_estimated():
    in_use = LensInUse(CAMERA, LensRefinementOptions(refine=False))
    in_use.begin(INTERVAL_S)
    in_use.update(found_of(CAMERA, focal=0.0, sigma=1.0, readout_s=0.0))
    assert in_use.camera == CAMERA
