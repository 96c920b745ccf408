"""Reduction of a run of any length to a bounded number of points."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from farpoint.errors import InputError
from farpoint.geometry.angles import heading_angles_deg, rotation_vector_deg
from farpoint.pose import PoseStatus
from farpoint.sinks.motions import Motions, iter_motions
from farpoint.sinks.report.moments import MomentSeeker

__all__ = ["MAX_BINS", "Digest", "Series", "count_lines", "digest_motions"]

MAX_BINS = 1800
"""Largest number of points of a curve. Longer runs are divided into bins of several pairs."""

_BINS_AT_ONCE = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """One quantity over time, NaN where unknown. All arrays have the shape (B,).

    Attributes
    ----------
    first, low, high : ndarray
        The first, lowest and highest value of each bin.
    """

    first: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Digest:
    """The data of a ``motions.csv`` that a report shows.

    Attributes
    ----------
    span_s : float
        Time from the first frame to the last, s; 0 if the file has no row.
    begin_s, time_s : ndarray, shape (B,)
        Times of the older and the newer frame of the first pair in each bin, s since the first
        frame.
    stride : int
        Pairs in a bin.
    worst : list of PoseStatus
        The least useful status within each bin.
    counts : dict of PoseStatus to int
        Pairs of each status, of the whole run.
    series : dict of str to Series
        Curves by name: degrees, pixels and counts.
    moments : MomentSeeker
        Search that has found the worst moments.
    """

    span_s: float
    begin_s: np.ndarray
    time_s: np.ndarray
    stride: int
    worst: list[PoseStatus]
    counts: dict[PoseStatus, int]
    series: dict[str, Series]
    moments: MomentSeeker


_WORSE = {status: rank for rank, status in enumerate(PoseStatus)}


def digest_motions(path: Path) -> Digest:
    """Read ``motions.csv`` in parts and reduce the rows to at most `MAX_BINS` bins."""
    stride = max(1, -(-count_lines(path) // MAX_BINS))
    counts = dict.fromkeys(PoseStatus, 0)
    times: list[np.ndarray] = [np.empty((0, 2))]
    worst: list[PoseStatus] = []
    parts: list[dict[str, Series]] = []
    start_s: float | None = None
    end_s = 0.0
    moments = MomentSeeker(0.0)
    for motions in iter_motions(path, chunk_rows=stride * _BINS_AT_ONCE):
        if start_s is None:
            start_s = float(motions.timestamp0[0])
            moments = MomentSeeker(start_s)
        starts = np.arange(0, len(motions), stride)
        for status in PoseStatus:
            counts[status] += int(np.sum(motions.status == status))
        end_s = float(motions.timestamp1[-1])
        both = np.stack([motions.timestamp0, motions.timestamp1], axis=1)
        times.append(both[starts] - start_s)
        worst += [
            max(motions.status[start : start + stride], key=_WORSE.__getitem__) for start in starts
        ]
        quantities = _quantities(motions)
        moments.look(motions, quantities)
        parts.append({name: _binned(row, starts) for name, row in quantities.items()})
    begin_s, time_s = np.concatenate(times).T
    return Digest(
        span_s=end_s - (start_s or 0.0),
        begin_s=begin_s,
        time_s=time_s,
        stride=stride,
        worst=worst,
        counts=counts,
        series={name: _joined(part[name] for part in parts) for name in parts[0]} if parts else {},
        moments=moments,
    )


def _quantities(motions: Motions) -> dict[str, np.ndarray]:
    """The quantities of all curves of the page, by name, with a value for each pair."""
    R, covariance = motions.rotation_cam1_from_cam0, motions.rotation_covariance
    rotation, rotation_sigma = rotation_vector_deg(R, covariance)
    elapsed_s = motions.timestamp1 - motions.timestamp0
    heading, heading_covariance = _headings(motions, R)
    angles, angles_sigma = heading_angles_deg(heading, heading_covariance)
    return {
        **{f"rotation_{axis}": rotation[:, k] for k, axis in enumerate("xyz")},
        **{f"rotation_{axis}_sigma": rotation_sigma[:, k] for k, axis in enumerate("xyz")},
        "right": angles[:, 0],
        "right_sigma": angles_sigma[:, 0],
        "up": angles[:, 1],
        "up_sigma": angles_sigma[:, 1],
        "rotation_sigma": _largest_sigma_deg(covariance),
        "direction_sigma": _largest_sigma_deg(motions.covariance[:, 3:, 3:]),
        "rate": np.linalg.norm(rotation, axis=1) / np.maximum(elapsed_s, 1e-6),
        "scale": motions.scale,
        "scale_sigma": motions.scale_sigma,
        "noise_px": motions.noise_px,
        "far": motions.far.astype(float),
        "near": motions.near.astype(float),
        "outliers": motions.outliers.astype(float),
    }


def _headings(motions: Motions, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Headings in camera 0 (M, 3) with covariances (M, 3, 3), defined as in `RelativePose`."""
    direction = motions.direction_cam1_from_cam0
    skew = np.swapaxes(np.cross(direction[:, None, :], np.eye(3)), 1, 2)
    R_T = np.swapaxes(R, 1, 2)
    jacobian = -R_T @ np.concatenate([skew, motions.direction_basis], axis=2)
    covariance = jacobian @ motions.covariance @ np.swapaxes(jacobian, 1, 2)
    return -np.einsum("mij,mj->mi", R_T, direction), covariance


def _largest_sigma_deg(covariance: np.ndarray) -> np.ndarray:
    """1-sigma (M,) along the longest axis of each covariance (M, K, K), deg."""
    sigma = np.full(len(covariance), np.nan)
    known = np.isfinite(covariance).all(axis=(1, 2))
    sigma[known] = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance[known])[:, -1], 0.0))
    return np.rad2deg(sigma)


def _binned(values: np.ndarray, starts: np.ndarray) -> Series:
    return Series(
        first=values[starts],
        low=np.fmin.reduceat(values, starts),
        high=np.fmax.reduceat(values, starts),
    )


def _joined(parts: Iterable[Series]) -> Series:
    parts = list(parts)
    return Series(
        first=np.concatenate([part.first for part in parts]),
        low=np.concatenate([part.low for part in parts]),
        high=np.concatenate([part.high for part in parts]),
    )


def count_lines(path: Path) -> int:
    """Number of lines of a file of any length, including the header."""
    try:
        with path.open("rb") as file:
            return sum(block.count(b"\n") for block in iter(lambda: file.read(1 << 20), b""))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
