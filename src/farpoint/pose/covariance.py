"""How sure a motion is: the covariance of its rotation and direction."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.information import information
from farpoint._kernels.likelihood import clutter_density
from farpoint._kernels.linear import sandwich
from farpoint.pose.fits import MovingFit
from farpoint.pose.information import inverse_root, positive
from farpoint.pose.matches import Matches

__all__ = ["moving_covariance", "shared_covariance"]

# Where more than three quarters of what the flow tells, along any axis, are noise, the covariance
# no longer holds: points that are all far have such flow, and half of their directions are wrong.
SIGNAL = 0.25
# Where nearly all of the flow is noise, the curvature cannot tell how little of it is signal.
LEAST_SIGNAL = 0.05
# Matches whose residuals weigh as much as the noise that was found, in saying how the gradient
# varies: few residuals tell little of it.
STATED = 60.0
# Information of one radian on the direction, none on the rotation: the sphere is bounded.
DIRECTION_PRIOR = np.diag([0.0, 0.0, 0.0, 1.0, 1.0])


def moving_covariance(matches: Matches, fit: MovingFit) -> tuple[np.ndarray, bool]:
    """Covariance (5, 5) of ``[dtheta, dbeta]``, rad^2, in the `tangent_basis` of the direction.

    And whether the flow holds signal enough to tell a direction.

    The sandwich ``H^-1 V H^-1`` of the curvature H of the expected likelihood and the variance V of
    its gradient. Since the depths are estimated along, the Gauss-Newton matrix counts the noise in
    the flow as if it were flow; H does not. V is that matrix if the noise is what was found, and
    the scatter of the gradient over the matches whatever it is: both are heard, the scatter the
    more, the more matches there are. H lacks the information that is lost for not knowing which
    matches are good. The noise is estimated too, from few matches roughly: on average its inverse
    is too large by ``f / (f - 2)`` with f degrees of freedom, and the covariance is made larger by
    as much. The scatter along one axis is that of some matches only: as far as it is heard, by
    ``f / (f - 5)``.

    Where nearly all of the Gauss-Newton matrix is noise, it alone tells the scale, by the least
    share of it that is taken to be signal.
    """
    whole, noise, scatter = np.empty((3, 5, 5))
    known = information(
        matches.pairs,
        fit.prior,
        fit.R_cam1_from_cam0,
        fit.direction_cam1_from_cam0,
        fit.noise.array,
        clutter_density(fit.noise.variance, fit.noise.wrong, matches.spread),
        whole,
        noise,
        scatter,
    )
    right = float(fit.probability.sum())
    heard = right / (right + STATED)
    freedom = max(right - 5.0, 4.0)
    sure = (freedom - 2.0 - 3.0 * heard) / freedom
    whole *= known * sure
    noise *= known * sure
    variance = (heard * sure) * scatter + (1.0 - heard) * whole + DIRECTION_PRIOR
    whole += DIRECTION_PRIOR
    covariance = np.empty((5, 5))
    if sandwich(whole, noise, variance, SIGNAL, covariance):
        return positive(covariance), True
    if not (np.isfinite(whole).all() and np.isfinite(noise).all()):
        return np.full((5, 5), np.inf), False
    # In the axes in which V is the identity, H is what is left of it without the share of noise.
    whiten = inverse_root(whole)
    share, vectors = np.linalg.eigh(whiten.T @ noise @ whiten)
    root = whiten @ vectors / np.clip(1.0 - share, LEAST_SIGNAL, 1.0)
    return positive(root @ root.T), False


def shared_covariance(matches: Matches, sigma: float) -> np.ndarray:
    """Covariance (3, 3), rad^2, of a rotation by which all matches are off alike, by ``sigma``.

    As large as the rotation that moves a typical match by ``sigma``, in units of the noise.
    """
    if sigma == 0.0:
        return np.zeros((3, 3))
    per_unit = 0.5 * float(np.median(1.0 / matches.precision))  # rad^2; both images have noise
    return sigma**2 * per_unit * np.eye(3)
