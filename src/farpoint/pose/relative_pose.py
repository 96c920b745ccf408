"""The method on one screen: rotation from far rays, direction of travel from the flow that remains,
both refined together, and a verdict on what the matches can tell.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from farpoint._kernels.compile import AnnouncedCompilation
from farpoint._kernels.motion import fit_motion
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.pose.as_motion import conclude_motion
from farpoint.pose.as_turn import conclude_turn
from farpoint.pose.candidates import likeliest_motion
from farpoint.pose.closed_form import estimate_closed_form
from farpoint.pose.conclusion import Course, failed_pose
from farpoint.pose.far_rotation import far_rotation
from farpoint.pose.lens_uncertainty import View, with_lens_uncertainty
from farpoint.pose.matches import Matches, PixelMatches, matches_from_rays
from farpoint.pose.moving_fit import MovingFit, fit_moving, refit_moving
from farpoint.pose.neighbours import doubt_where_alike
from farpoint.pose.noise_floor import noise_floor
from farpoint.pose.options import DEFAULTS, RelativePoseOptions
from farpoint.pose.result import RelativePose, TrackLabel
from farpoint.pose.shutter import Shutter, shutter_of
from farpoint.pose.turning_fit import fit_turning, turning_when_asked
from farpoint.pose.two_motions import CORRELATED, dominant_motion, without_stationary
from farpoint.pose.verdict import is_plainly_translating, shown_translation

__all__ = [
    "estimate_from",
    "estimate_relative_pose",
    "estimate_relative_pose_from_rays",
    "rough_motion",
    "search_motion",
]

_MOST_PASSES = 4
_CLOSE = 0.1  # sigma: no pass changes more
# Five matches fix a motion; a consensus needs a few more that could have disagreed.
MIN_MATCHES = 8


def estimate_relative_pose(
    points0: np.ndarray,
    points1: np.ndarray,
    camera0: Camera,
    camera1: Camera | None = None,
    *,
    options: RelativePoseOptions | None = None,
    seed: int = 0,
    covariance0_px2: np.ndarray | None = None,
    covariance1_px2: np.ndarray | None = None,
    readout_s: float | None = None,
    interval_s: float | None = None,
) -> RelativePose:
    """Motion between two views of calibrated cameras, with its covariance.

    Parameters
    ----------
    points0, points1 : ndarray, shape (N, 2)
        Matching pixels in image 0 and image 1; the centre of the top-left pixel is (0, 0).
    camera0 : Camera
        Camera of image 0, and of image 1 unless ``camera1`` is given. An uncertain one
        (`Camera.with_uncertainty`) widens the covariance.
    camera1 : Camera, optional
        Camera of image 1.
    options : RelativePoseOptions, optional
        Defaults serve tracks and still matches alike.
    seed : int
        Of the random samples; the same inputs, options and seed give the same result, bit for bit.
    covariance0_px2, covariance1_px2 : ndarray, shape (N, 2, 2), optional
        Noise of each point, px^2, up to a common factor, which is estimated. An image without is
        taken to have isotropic noise of the median variance of the other.
    readout_s : float, optional
        Read-out time of a rolling shutter, first row to last, s; negative where the last row is
        read first. Both images are read alike, and the camera keeps its velocities from one to
        the other. The motion is that from middle row to middle row. Without it that of
        ``camera0``, whose 1-sigma widens the covariance, counts where ``interval_s`` is given.
    interval_s : float, optional
        Time between the two views, s.

    Returns
    -------
    RelativePose
        With a status: too few or contradicting matches are no error.

    Raises
    ------
    ValueError
        Wrong shapes, unequal counts, NaN or infinite values, a read-out time without an interval
        or longer than it; names the argument.

    Notes
    -----
    Burschka and Mair, "Direct Pose Estimation with a Monocular Camera", Robot Vision 2008,
    LNCS 4931, then refined to the maximum likelihood.

    Examples
    --------
    >>> import numpy as np
    >>> from farpoint import Camera, estimate_relative_pose
    >>> camera = Camera.pinhole(640, 480, 500, 500, 319.5, 239.5)
    >>> estimate_relative_pose(np.empty((0, 2)), np.empty((0, 2)), camera).status
    <PoseStatus.FAILED: 'FAILED'>
    """
    given = points0, points1, camera0, camera1 or camera0, covariance0_px2, covariance1_px2
    return estimate_from(None, *given, options or DEFAULTS, seed, readout_s, interval_s)


def estimate_from(
    start: MovingFit | None,
    points0: np.ndarray,
    points1: np.ndarray,
    camera0: Camera,
    camera1: Camera,
    covariance0_px2: np.ndarray | None,
    covariance1_px2: np.ndarray | None,
    options: RelativePoseOptions,
    seed: int,
    readout_s: float | None,
    interval_s: float | None,
) -> RelativePose:
    """As `estimate_relative_pose`, without a search where one has led to this ``start``.

    That of the same matches, before their pixels were corrected.
    """

    def by(
        options: RelativePoseOptions, camera0: Camera, camera1: Camera, shutter: Shutter | None
    ) -> RelativePose:
        """The motion through these lenses and this shutter."""
        pixels = PixelMatches.of(
            points0, points1, camera0, camera1, covariance0_px2, covariance1_px2
        )
        if shutter is None or shutter.share == 0.0:
            tolerance = options.matching_tolerance_px
            return _estimate(pixels.matches(), tolerance, options, seed, start)
        return _rolling(shutter, pixels, options, seed, start)

    shutter = shutter_of(camera0, points0, points1, readout_s, interval_s)
    pose = by(options, camera0, camera1, shutter)
    views = View(points0, camera0), View(points1, camera1)
    undealt = partial(by, replace(options, half_deals=0))
    return with_lens_uncertainty(pose, *views, shutter, undealt, options.false_alarm_rate)


def search_motion(
    points0: np.ndarray,
    points1: np.ndarray,
    camera: Camera,
    covariance_px2: np.ndarray | None,
    options: RelativePoseOptions,
    seed: int,
) -> MovingFit | None:
    """The motion that a search finds of matches by one camera; None of too few.

    ``covariance_px2`` (N, 2, 2) is that of a point in each image.
    """
    noise = covariance_px2, covariance_px2
    pixels = PixelMatches.of(points0, points1, camera, camera, *noise)
    return _searched(pixels.matches(), options, seed)


def rough_motion(
    fit: MovingFit, options: RelativePoseOptions
) -> tuple[np.ndarray, np.ndarray | None]:
    """Rotation, cam1_from_cam0, and direction of a motion that was searched for, if it is shown."""
    if is_plainly_translating(fit):
        return fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    matches, tolerance = fit.matches, options.matching_tolerance_px
    turned = fit_turning(matches, fit.far_rotation_cam1_from_cam0, tolerance)
    if shown_translation(matches, fit, turned, options.false_alarm_rate) >= 1.0:
        return fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    return turned.R_cam1_from_cam0, None


def _searched(matches: Matches, options: RelativePoseOptions, seed: int) -> MovingFit | None:
    if len(matches) < MIN_MATCHES:
        return None
    with AnnouncedCompilation(fit_motion):
        return fit_moving(matches, options.matching_tolerance_px, options, _random_state(seed))


def estimate_relative_pose_from_rays(
    rays0: np.ndarray,
    rays1: np.ndarray,
    *,
    noise_rad: float,
    options: RelativePoseOptions | None = None,
    seed: int = 0,
) -> RelativePose:
    """Motion between two views of any central camera, from rays (N, 3) in camera 0 and camera 1.

    As `estimate_relative_pose` with the 1-sigma noise of a ray in each direction, ``noise_rad``
    (rad), as the unit: ``noise_px`` of the result is a multiple of it.
    """
    options = options or DEFAULTS
    matches = matches_from_rays(rays0, rays1, noise_rad)
    return _estimate(matches, max(options.matching_tolerance_px, 3.0), options, seed)


def _rolling(
    shutter: Shutter,
    pixels: PixelMatches,
    options: RelativePoseOptions,
    seed: int,
    start: MovingFit | None,
) -> RelativePose:
    """The motion whose own rotation, undone in each row, leads to itself.

    A fixed point: what is wrong of the rotation that is undone returns in the estimate by its share
    of the time between the rows. That all matches have in common is taken out (Newton); what is
    left shrinks by its spread in every pass.
    """
    spread = abs(shutter.share) * float(np.std(shutter.phase1 - shutter.phase0))

    def is_settled(before: np.ndarray, theta: np.ndarray, noise: float, matches: Matches) -> bool:
        # Of a rotation that all matches tell: what is stated is larger where two motions are met.
        sigma = noise / float(np.sqrt(np.sum(matches.precision)))
        return spread * float(np.linalg.norm(theta - before)) <= _CLOSE * sigma

    theta = np.zeros(3)
    if options.refine:
        start = start or _searched(pixels.matches(), options, seed)
    if start is not None:
        theta, _ = _unrolled(
            shutter, start.R_cam1_from_cam0, start.matches.used(start.labels), theta
        )
        for _ in range(_MOST_PASSES):
            matches = pixels.matches(partial(shutter.unrolled, theta))
            start = refit_moving(matches, start)
            used = matches.used(start.labels)
            before, (theta, _) = theta, _unrolled(shutter, start.R_cam1_from_cam0, used, theta)
            if is_settled(before, theta, start.noise.sigma / _CLOSE, matches):
                break  # what is left of it the next estimate finds
    for _ in range(_MOST_PASSES):
        matches = pixels.matches(partial(shutter.unrolled, theta))
        pose = _estimate(matches, options.matching_tolerance_px, options, seed, start)
        R, R_covariance, C = pose.rotation_cam1_from_cam0, pose.rotation_covariance, pose.covariance
        if R is None or R_covariance is None:
            return pose
        used = np.flatnonzero(pose.labels != TrackLabel.OUTLIER)
        before, (theta, time_between) = theta, _unrolled(shutter, R, used, theta)
        # The rows of a match see the rotation of the time between them.
        by_time = np.diag([1.0 / time_between] * 3 + [1.0, 1.0])
        found = replace(
            pose,
            rotation_cam1_from_cam0=so3.exp(theta),
            rotation_covariance=R_covariance / time_between**2,
            covariance=None if C is None else by_time @ C @ by_time,
        )
        assert pose.noise_px is not None
        if is_settled(before, theta, pose.noise_px, matches):
            break
    return found


def _unrolled(
    shutter: Shutter, R_cam1_from_cam0: np.ndarray, used: np.ndarray, theta: np.ndarray
) -> tuple[np.ndarray, float]:
    """Rotation vector of a motion that was estimated with ``theta`` undone, and rows' mean time.

    By the matches ``used``, indices.
    """
    time_between = shutter.time_between(used)
    found = so3.log(R_cam1_from_cam0)
    return (found + (time_between - 1.0) * theta) / time_between, time_between


def _estimate(
    matches: Matches,
    tolerance: float,
    options: RelativePoseOptions,
    seed: int,
    start: MovingFit | None = None,
) -> RelativePose:
    course = Course()
    if len(matches) < MIN_MATCHES:
        return failed_pose(
            f"Too few matches: {len(matches)} usable of {matches.total} given, "
            f"at least {MIN_MATCHES} are needed.",
            matches.total,
            course,
        )
    with AnnouncedCompilation(fit_motion):
        return _find(matches, tolerance, options, _random_state(seed), course, start)


def _find(
    matches: Matches,
    tolerance: float,
    options: RelativePoseOptions,
    state: np.ndarray,
    course: Course,
    start: MovingFit | None,
) -> RelativePose:
    if not options.refine:
        rotation = far_rotation(matches, tolerance, state)
        return estimate_closed_form(matches, rotation, tolerance, options, state, course)
    if start is None:
        moving = fit_moving(matches, tolerance, options, state)
    else:
        moving = refit_moving(matches, start)
    course.iterations = moving.iterations
    course.lap("search_s")
    floor = noise_floor(matches, moving)
    if floor and matches.told is not None:
        matches = matches.told.with_floor(floor)
        # What the search made of a plane, it did with noise that was told wrong.
        moving = replace(refit_moving(matches, moving), is_planar=True)
        course.lap("refinement_s")
    moving = likeliest_motion(matches, moving, tolerance, options, state)
    given = len(matches)
    matches, moving = without_stationary(matches, moving, tolerance, options, state)
    if len(matches) < given:
        course.remark(
            f"{given - len(matches)} matches stand still in the image: they go along with the "
            "camera, as dirt on its lens does."
        )
    moving = dominant_motion(matches, moving, tolerance, options, state)
    if max(moving.coherence, moving.between) > CORRELATED:
        course.remark(
            "Residuals of neighbouring matches are correlated: lens model, rolling shutter, moving "
            "objects or repeated structure."
        )
    if options.count_sharing:
        matches, moving = doubt_where_alike(matches, moving)
        course.sharing = matches.sharing
    turned = turning_when_asked(matches, moving.far_rotation_cam1_from_cam0, tolerance)
    if is_plainly_translating(moving):
        return conclude_motion(matches, moving, turned, options, course)
    shown = shown_translation(matches, moving, turned(), options.false_alarm_rate)
    if shown >= 1.0:
        return conclude_motion(matches, moving, turned, options, course)
    return conclude_turn(matches, turned(), moving, shown, options, course)


def _random_state(seed: int) -> np.ndarray:
    if not isinstance(seed, (int, np.integer)):
        raise InputError(f"expected a whole number, got {seed!r}", field="seed")
    return np.array([int(seed) % 2**64], np.uint64)
