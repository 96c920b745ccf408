"""Speeds and positions from the bag of the images, with their covariances."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from farpoint.aiding.kinds import GnssPositions, KnownSpeed
from farpoint.aiding.tables import earth_centred
from farpoint.errors import InputError
from farpoint.frames.bags import Bag, rows_of

__all__ = ["positions_of_topic", "speeds_of_topic"]

_SPEEDS = frozenset({"Odometry", "TwistStamped", "TwistWithCovarianceStamped"})
_FIXES = frozenset({"NavSatFix"})
_NO_FIX, _UNKNOWN = -1, 0  # NavSatStatus.STATUS_NO_FIX, NavSatFix.COVARIANCE_TYPE_UNKNOWN


def speeds_of_topic(bag: Bag, topic: str, sigma: float) -> KnownSpeed:
    """Speeds from a topic: norms of the linear velocities in its messages.

    Parameters
    ----------
    bag : Bag
        The bag of the images.
    topic : str
        Name of a topic with ``nav_msgs/Odometry``, ``geometry_msgs/TwistStamped`` or
        ``TwistWithCovarianceStamped``.
    sigma : float
        Relative 1-sigma of the error common to all speeds. If any message has no covariance,
        ``sigma`` is also the relative 1-sigma of the independent error of each second.

    Raises
    ------
    InputError
        If there is no such topic, or fewer than 2 of its messages can be used.
    """
    what = "speeds (Odometry, TwistStamped, TwistWithCovarianceStamped)"
    rows = rows_of(bag, topic, _SPEEDS, _speed, what, field="--metric.speed-topic")
    table = _table(rows, bag, topic)
    return KnownSpeed(
        timestamps_s=table[:, 0],
        speeds=table[:, 1],
        sigma=sigma,
        sigmas_mps=_unless_unknown(table[:, 2]),
    )


def positions_of_topic(bag: Bag, topic: str, sigma_m: float) -> GnssPositions:
    """Positions from a topic with ``sensor_msgs/NavSatFix``. Messages without a fix are skipped.

    Parameters
    ----------
    bag : Bag
        The bag of the images.
    topic : str
        Name of the topic.
    sigma_m : float
        1-sigma of each coordinate, m. If any message has no covariance, ``sigma_m`` is used for all
        positions; otherwise the covariances of the messages are used.

    Raises
    ------
    InputError
        If there is no such topic, or fewer than 2 of its messages can be used.
    """
    rows = rows_of(bag, topic, _FIXES, _fix, "NavSatFix", field="--metric.gnss-topic")
    table = _table(rows, bag, topic)
    latitude, longitude = np.radians(table[:, 1:3]).T
    return GnssPositions(
        timestamps_s=table[:, 0],
        positions_m=earth_centred(latitude, longitude, table[:, 3]),
        sigma_m=sigma_m,
        sigmas_m=_unless_unknown(table[:, 4]),
    )


def _speed(message: Any) -> tuple[float, float] | None:
    """Speed and the 1-sigma of the speed, m/s; None if the speed is not finite."""
    velocity, covariance = _velocity(message)
    speed = float(np.linalg.norm(velocity))
    return (speed, _sigma_along(velocity, covariance)) if math.isfinite(speed) else None


def _fix(fix: Any) -> tuple[float, ...] | None:
    """Latitude and longitude, deg, height, m, and the largest 1-sigma of a coordinate, m."""
    degrees = (fix.latitude, fix.longitude, fix.altitude)
    usable = all(map(math.isfinite, degrees)) and abs(fix.latitude) <= 90.0
    if not usable or fix.status.status <= _NO_FIX:
        return None
    return (*degrees, _sigma_of_fix(fix))


def _velocity(message: Any) -> tuple[np.ndarray, np.ndarray | None]:
    """Linear velocity (3,), m/s, and its covariance (3, 3); None for a missing covariance."""
    twist, covariance = message.twist, getattr(message.twist, "covariance", None)
    linear = twist.linear if covariance is None else twist.twist.linear
    velocity = np.array([linear.x, linear.y, linear.z])
    if covariance is None:
        return velocity, None
    return velocity, np.asarray(covariance).reshape(6, 6)[:3, :3]


def _sigma_along(velocity: np.ndarray, covariance: np.ndarray | None) -> float:
    """1-sigma of the speed, m/s; NaN if the covariance is unknown (missing, zero or negative)."""
    speed = np.linalg.norm(velocity)
    along = velocity / speed if speed > 0.0 else np.array([1.0, 0.0, 0.0])
    variance = math.nan if covariance is None else float(along @ covariance @ along)
    return math.sqrt(variance) if 0.0 < variance < math.inf else math.nan


def _sigma_of_fix(fix: Any) -> float:
    """Largest 1-sigma of a coordinate of a fix, m; NaN if unknown."""
    variance = float(np.max(np.asarray(fix.position_covariance).reshape(3, 3).diagonal()))
    if fix.position_covariance_type == _UNKNOWN or not 0.0 < variance < math.inf:
        return math.nan
    return math.sqrt(variance)


def _table(rows: list[tuple[float, ...]], bag: Bag, topic: str) -> np.ndarray:
    if len(rows) < 2:
        raise InputError(
            f"expected at least 2 messages that can be used, got {len(rows)}",
            file=bag.path,
            field=topic,
        )
    return np.array(rows)


def _unless_unknown(sigmas: np.ndarray) -> np.ndarray | None:
    """The sigmas; None if any of them is unknown (NaN)."""
    return None if np.isnan(sigmas).any() else sigmas
