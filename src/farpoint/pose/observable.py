"""Observable motion, and distance of far points (Burschka and Mair 2008, eq. 6)."""

from __future__ import annotations

import math

import numpy as np

from farpoint.errors import InputError

__all__ = ["far_distance", "observable_motion"]


def observable_motion(motion_m: float, gamma_rad: float, phi_rad: float) -> float:
    """Observable motion ``T_m = cos(gamma) / cos(phi) * dT`` of the camera, metres (eq. 6).

    Parameters
    ----------
    motion_m : float
        Length dT of the camera's motion.
    gamma_rad : float
        Angle between the motion and the perpendicular to the viewing ray. pi/2 is a motion along
        the ray, which does not shift the point in the image.
    phi_rad : float
        Angle between the viewing ray and the optical axis, below pi/2 in absolute value.

    Returns
    -------
    float
        Length of the motion parallel to the image plane that shifts the point in the image by as
        much as the given motion.

    Notes
    -----
    Burschka and Mair, "Direct Pose Estimation with a Monocular Camera", Robot Vision 2008.

    Examples
    --------
    >>> observable_motion(1.0, 0.0, 0.0)
    1.0
    """
    if not abs(phi_rad) < math.pi / 2:
        raise InputError(f"expected an angle below pi/2, got {phi_rad!r}", field="phi_rad")
    return abs(math.cos(gamma_rad)) / math.cos(phi_rad) * motion_m


def far_distance(
    observable_motion_m: float | np.ndarray, focal_px: float, shift_px: float = 1.0
) -> float | np.ndarray:
    """Distance ``Z_inf = f / s_x * T_m`` beyond which a motion shows no image shift (eq. 6).

    Parameters
    ----------
    observable_motion_m : float or ndarray
        T_m of `observable_motion`, metres.
    focal_px : float
        Focal length over pixel size, ``f / s_x``, px.
    shift_px : float
        Smallest observable shift, px; one pixel in the paper.

    Returns
    -------
    float or ndarray
        Distance along the optical axis, metres.

    Examples
    --------
    >>> far_distance(observable_motion(0.1, 0.0, 0.0), focal_px=700.0)
    70.0
    """
    for name, value in (("focal_px", focal_px), ("shift_px", shift_px)):
        if not value > 0:
            raise InputError(f"expected a positive number of pixels, got {value!r}", field=name)
    return focal_px / shift_px * observable_motion_m
