"""One comparison of a known length with the same length in the unit of the trajectory."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Reading"]


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Metres for a unit of the trajectory, as a hint has them over some seconds.

    Attributes
    ----------
    kind : str
        The hint it comes from.
    start_s, end_s : float
        Times between which the lengths were compared, s.
    segment : int
        Of the trajectory.
    log_ratio : float
        Logarithm of metres for a unit.
    sigma : float
        1-sigma of it, this reading's alone.
    shared_sigma : float
        1-sigma of an error that all readings of the kind have in common.
    drift : float
        Variance that the scale of the trajectory has gathered until then, of its logarithm, since
        the beginning of the segment: what may have changed in between.
    """

    kind: str
    start_s: float
    end_s: float
    segment: int
    log_ratio: float
    sigma: float
    shared_sigma: float
    drift: float
