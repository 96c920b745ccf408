"""A motion from points of known distance, where two views alone leave its direction open.

Two views of a plane, or of few matches, may allow two motions, or a flow too short to show where it
comes from. Points whose distances earlier motions have told leave no such choice: where such points
are seen next fixes rotation and translation at once, the length included.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from farpoint.camera import Camera
from farpoint.geometry.so3 import exp
from farpoint.geometry.sphere import tangent_basis
from farpoint.pose import PoseStatus, RelativePose, TrackLabel
from farpoint.tracks import Tracks
from farpoint.trajectory.depths import Depths
from farpoint.trajectory.parallax import displacement_noise_px2
from farpoint.trajectory.scale import MIN_POINTS, ScaleFit, can_fit

__all__ = ["Resection", "resect"]

_DOF = 5.0  # of the t distribution of deviations, as for lengths
_WIDE = 1e4  # of the noise at first, in variance: the rotation may be some degrees off
_NARROWING = 10.0  # by which it comes down with every step
_MAX_STEPS = 20
_TOLERANCE_RAD = 1e-7
_MEDIAN = 1.386  # of chi-square with two degrees of freedom
_MAX_DIRECTION_SIGMA = 0.1  # rad: a translation less sure may be none


class Resection(NamedTuple):
    """A motion with its length.

    Attributes
    ----------
    motion : RelativePose
        OK, with rotation, direction and their covariance from the points.
    fit : ScaleFit
        Its length in the unit of the trajectory.
    """

    motion: RelativePose
    fit: ScaleFit


def resect(
    camera: Camera, tracks: Tracks, motion: RelativePose, depths: Depths
) -> Resection | None:
    """Maximum likelihood of rotation and translation over points whose distances are known.

    Model: ``points1_j = project(R ray0_j + k_j T) + noise_j``, the inverse distance ``k_j`` with
    its own error, eliminated; deviations are t-distributed.

    Parameters
    ----------
    camera : Camera
        Of both frames.
    tracks : Tracks
        The matches behind the motion, aligned with its labels.
    motion : RelativePose
        Any but FAILED. Of it the rotation is the start, and the noise is taken over.
    depths : Depths
        From camera 0.

    Returns
    -------
    Resection or None
        None where too few distances are known, or no translation stands out.
    """
    good = tracks.select(motion.labels != TrackLabel.OUTLIER)
    good = good.select(np.isfinite(depths.of(good.ids)[1]))
    if not can_fit(depths, good.ids):
        return None
    points = _known_points(camera, good, motion, depths)
    assert motion.rotation_cam1_from_cam0 is not None
    R, T, wide = motion.rotation_cam1_from_cam0, np.zeros(3), _WIDE
    for _ in range(_MAX_STEPS):
        equations = _equations(_reproject(points, R, T), wide)
        if not _fix_a_motion(equations):
            return None
        step = -np.linalg.solve(equations.H, equations.g)
        R, T = exp(step[:3]) @ R, T + step[3:]
        if wide == 1.0 and float(np.linalg.norm(step[:3])) < _TOLERANCE_RAD:
            break
        wide = max(wide / _NARROWING, 1.0)
    return _concluded(motion, R, T, _reproject(points, R, T))


class _Points(NamedTuple):
    """Tracks (N,), their rays of both cameras (N, 3), inverse distances from camera 0 (N,) with
    their variances, what makes pixels of small changes of a ray of camera 1 (N, 2, 3), and the
    covariances (N, 2, 2) of the noise, px^2.
    """

    ids: np.ndarray
    rays0: np.ndarray
    rays1: np.ndarray
    inverse: np.ndarray
    variance: np.ndarray
    to_px: np.ndarray
    noise_px2: np.ndarray


def _known_points(camera: Camera, tracks: Tracks, motion: RelativePose, depths: Depths) -> _Points:
    inverse, variance = depths.of(tracks.ids)
    rays1 = camera.unproject(tracks.points1)
    return _Points(
        ids=tracks.ids,
        rays0=camera.unproject(tracks.points0),
        rays1=rays1,
        inverse=inverse,
        variance=variance,
        to_px=np.linalg.pinv(camera.unproject_jacobian(rays1)),
        noise_px2=displacement_noise_px2(tracks, motion),
    )


class _Reprojected(NamedTuple):
    """Tracks (N,), their errors of reprojection (N, 2), px, with the covariances (N, 2, 2) of their
    noise, and what they change by with ``dtheta`` (N, 2, 3), with the translation for a unit of the
    inverse distance (N, 2, 3), and with that distance (N, 2), known as ``inverse`` with its
    ``variance``.
    """

    ids: np.ndarray
    off: np.ndarray
    noise: np.ndarray
    by_turn: np.ndarray
    by_point: np.ndarray
    by_inverse: np.ndarray
    inverse: np.ndarray
    variance: np.ndarray

    @property
    def noise_of_distance(self) -> np.ndarray:
        """Covariances (N, 2, 2) that the errors of the distances add."""
        outer = self.by_inverse[:, :, None] * self.by_inverse[:, None, :]
        return outer * self.variance[:, None, None]


class _Equations(NamedTuple):
    """Information (6, 6) and gradient (6,) by ``[dtheta, dT]``, with its derivative by the inverse
    distances (6, N), and squared Mahalanobis distances (N,) of the points from where they are
    expected.
    """

    H: np.ndarray
    g: np.ndarray
    g_by_inverse: np.ndarray
    distance2: np.ndarray


def _reproject(points: _Points, R: np.ndarray, T: np.ndarray) -> _Reprojected:
    """Those that are not behind; about the rays that were seen, where any image is smooth."""
    turned = points.rays0 @ R.T
    at = turned + points.inverse[:, None] * T
    distance = np.linalg.norm(at, axis=1)
    ahead = at / distance[:, None]
    across = np.eye(3) - ahead[:, :, None] * ahead[:, None, :]
    by_point = points.to_px @ across / distance[:, None, None]
    seen = np.sum(ahead * points.rays1, axis=1) > 0.0
    by_point = by_point[seen]
    return _Reprojected(
        ids=points.ids[seen],
        off=np.einsum("nij,nj->ni", points.to_px[seen], ahead[seen]),
        noise=points.noise_px2[seen],
        by_turn=by_point @ _by_turn(turned[seen]),
        by_point=by_point,
        by_inverse=by_point @ T,
        inverse=points.inverse[seen],
        variance=points.variance[seen],
    )


def _by_turn(turned: np.ndarray) -> np.ndarray:
    """Derivative (N, 3, 3) of ``Exp(dtheta) @ turned`` by ``dtheta``."""
    x, y, z = turned.T
    nil = np.zeros_like(x)
    return np.stack([[nil, z, -y], [-z, nil, x], [y, -x, nil]]).transpose(2, 0, 1)


def _equations(seen: _Reprojected, wide: float) -> _Equations:
    weight = np.linalg.inv(wide * seen.noise + seen.noise_of_distance)
    weighted_off = np.einsum("nij,nj->ni", weight, seen.off)
    # The most likely distances, given the motion: with those told, it would be a little too short.
    likely = seen.inverse - seen.variance * np.sum(seen.by_inverse * weighted_off, axis=1)
    J = np.concatenate([seen.by_turn, seen.by_point * likely[:, None, None]], axis=2)
    distance2 = np.sum(seen.off * weighted_off, axis=1)
    heard = (_DOF + 2.0) / (_DOF + distance2)
    weighted = heard[:, None, None] * (weight @ J)
    return _Equations(
        H=np.einsum("nia,nib->ab", J, weighted),
        g=np.einsum("nia,ni->a", weighted, seen.off),
        g_by_inverse=np.einsum("nia,ni->an", weighted, seen.by_inverse),
        distance2=distance2,
    )


def _fix_a_motion(equations: _Equations) -> bool:
    """Whether the points do: not where too few are in view, or all on one line."""
    H = equations.H
    return bool(np.isfinite(H).all()) and int(np.linalg.matrix_rank(H)) == len(H)


def _concluded(
    motion: RelativePose, R: np.ndarray, T: np.ndarray, seen: _Reprojected
) -> Resection | None:
    length = float(np.linalg.norm(T))
    if len(seen.off) < MIN_POINTS or length == 0.0:
        return None
    t = T / length
    basis = tangent_basis(t)
    by_pose = np.zeros((6, 6))  # [log(length), dtheta, dbeta] by [dtheta, dT]
    by_pose[0, 3:], by_pose[1:4, :3], by_pose[4:, 3:] = t / length, np.eye(3), basis.T / length
    equations = _equations(seen, 1.0)
    if not _fix_a_motion(equations):
        return None
    by_gradient = by_pose @ np.linalg.inv(equations.H)
    # Points that lie farther off than their errors let them say less than these errors do.
    excess = max(float(np.median(equations.distance2)) / _MEDIAN, 1.0)
    # Fisher information of the t distribution is less than the weights' sum says.
    less = (_DOF + 4.0) / (_DOF + 2.0)
    covariance = less * excess * by_gradient @ by_pose.T
    if np.linalg.eigvalsh(covariance[4:, 4:])[-1] > _MAX_DIRECTION_SIGMA**2:
        return None
    moved = replace(
        motion,
        status=PoseStatus.OK,
        rotation_cam1_from_cam0=R,
        rotation_covariance=covariance[1:4, 1:4],
        direction_cam1_from_cam0=t,
        direction_basis=basis,
        covariance=covariance[1:, 1:],
    )
    fit = ScaleFit(
        scale=length,
        correction=np.zeros(5),
        covariance=covariance,
        gain=_gain(seen, t),
        ids=seen.ids,
        by_inverse=-by_gradient @ equations.g_by_inverse,
    )
    return Resection(motion=moved, fit=fit)


def _gain(seen: _Reprojected, t: np.ndarray) -> float:
    """Share of an error of the length that the distances take over, as of `ScaleFit`."""
    weight = np.linalg.inv(seen.noise + seen.noise_of_distance)
    along = seen.inverse[:, None] * (seen.by_point @ t)
    share = np.einsum("ni,nij,nj->n", along, weight, along)
    taken = np.einsum("nij,nji->n", weight, seen.noise_of_distance)
    return float(share @ taken / np.sum(share))
