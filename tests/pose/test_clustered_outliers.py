"""Outliers on a moving object or on repeated structure, some of which agree with the motion."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from pose_kit import direction_error, estimate, point_scene, rotation_error

from farpoint import Camera
from farpoint.geometry.sphere import normalize
from farpoint.metrics import chi2_quantile
from farpoint.pose.clustered_outliers import count_clustered_outliers
from farpoint.pose.general_motion import GeneralMotionFit, fit_general_motion
from farpoint.pose.matches import matches_from_points
from farpoint.pose.options import DEFAULTS
from farpoint.synthetic.pairs import HardPair, court, crossing

RATE = DEFAULTS.false_alarm_rate


def fit_of(scene: HardPair) -> GeneralMotionFit:
    matches = matches_from_points(scene.points0, scene.points1, scene.camera, scene.camera)
    return fit_general_motion(matches, 1.5, DEFAULTS, np.array([1], np.uint64))


@pytest.mark.parametrize(
    ("scene_of", "least"),
    [
        (partial(crossing, share=0.2, at_rest=False), 0.82),
        (partial(court, matches=150, repeated=0.4), 0.88),
    ],
)
def test_outliers_that_agree_by_chance_do_not_mislead(scene_of, least):
    """0.75 and 0.84 of the poses are in their 95 % regions if each match is taken by itself."""
    inside = []
    for seed in range(180):
        scene = scene_of(seed)
        pose = estimate(scene)
        if pose.covariance is not None:
            direction = normalize(scene.translation_cam1_from_cam0)
            turn = rotation_error(pose, scene.rotation_cam1_from_cam0)
            error = np.concatenate([turn, direction_error(pose, direction)])
            inside.append(error @ np.linalg.solve(pose.covariance, error) < chi2_quantile(0.95, 5))
    assert len(inside) >= 175
    assert np.mean(inside) >= least


def test_matches_on_the_object_become_outliers_and_those_beside_it_do_not():
    before, after, lost = 0, 0, 0
    for seed in range(40):
        scene = crossing(seed, share=0.2, at_rest=False)
        fit = fit_of(scene)
        again = count_clustered_outliers(fit.matches, fit, RATE)
        wrong = scene.is_outlier[fit.matches.index]
        before += np.count_nonzero(fit.labels[wrong])
        after += np.count_nonzero(again.labels[wrong])
        lost += np.count_nonzero(fit.labels[~wrong]) - np.count_nonzero(again.labels[~wrong])
    assert after < 0.9 * before
    assert lost < 0.01 * 40 * 240


@pytest.mark.parametrize(("matches", "outliers"), [(300, 7), (300, 60), (110, 22)])
def test_outliers_that_are_few_or_anywhere_change_nothing(matches, outliers):
    for seed in range(20):
        fit = fit_of(point_scene(seed, matches=matches, outliers=outliers, noise_px=0.2))
        assert count_clustered_outliers(fit.matches, fit, RATE) is fit


def test_wrong_matches_in_a_wide_image_are_no_clusters():
    """Their residuals are shorter than the image is wide, which looks a little like a cluster."""
    wide = Camera.pinhole(1241, 376, 718.9, 718.9, 607.2, 185.2)
    ahead = {"camera": wide, "noise_px": 0.2, "translation_m": (0.05, 0.02, -0.8)}
    likelier = 0
    for seed in range(40):
        fit = fit_of(point_scene(seed, matches=110, outliers=22, **ahead))
        likelier += count_clustered_outliers(fit.matches, fit, 1.0) is not fit
        assert count_clustered_outliers(fit.matches, fit, RATE) is fit
    assert likelier > 0


def test_selected_matches_keep_their_odds():
    fit = fit_of(crossing(1, share=0.2, at_rest=False))
    matches = count_clustered_outliers(fit.matches, fit, RATE).matches
    assert matches.prior_odds is not None
    rows = np.array([3, 1, 200])
    np.testing.assert_array_equal(matches.select(rows).prior_odds, matches.prior_odds[rows])
    odds = matches.packed(matches.weights(), soft_cheirality=True).odds
    np.testing.assert_array_equal(odds[: len(matches)], matches.prior_odds)
    assert not odds[len(matches) :].any()
