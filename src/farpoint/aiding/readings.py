"""One comparison of a known length with the corresponding length in the unit of the trajectory."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Reading"]


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Metres per unit of the trajectory, from one aiding measurement over some seconds.

    Attributes
    ----------
    kind : str
        Kind of aiding measurement.
    start_s, end_s : float
        Times between which the lengths were compared, s.
    segment : int
        Segment of the trajectory.
    log_ratio : float
        Logarithm of metres per unit.
    sigma : float
        1-sigma of the independent error of ``log_ratio``.
    shared_sigma : float
        1-sigma of an error that all readings of the kind have in common.
    drift : float
        Variance of the change of the logarithm of the trajectory's scale since the segment began.
    """

    kind: str
    start_s: float
    end_s: float
    segment: int
    log_ratio: float
    sigma: float
    shared_sigma: float
    drift: float
