"""How sure a motion is: the covariance of its rotation and direction."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.information import covariance_beside, information
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
# Up to this sigma of the direction over both axes, rad, all poses that the covariance allows tell
# about the same.
STRAIGHT_SIGMA = math.radians(1.5)
# How much larger than the covariance of one pose the mean over all may be.
MOST_GROWTH = 8.0
# Information of one radian on the direction, none on the rotation: the sphere is bounded.
DIRECTION_PRIOR = np.diag([0.0, 0.0, 0.0, 1.0, 1.0])
NO_STEP = np.zeros(5)


def moving_covariance(matches: Matches, fit: MovingFit) -> tuple[np.ndarray, bool]:
    """Covariance (5, 5) of ``[dtheta, dbeta]``, rad^2, in the `tangent_basis` of the direction.

    And whether the flow holds signal enough to tell a direction.

    The sandwich ``H^-1 V H^-1`` of the curvature H of the expected likelihood and the variance V of
    its gradient. Since the depths are estimated along, the Gauss-Newton matrix counts the noise in
    the flow as if it were flow; H does not. V is that matrix if the noise is what was found, and
    the scatter of the gradient over the matches whatever it is: both are heard, the scatter the
    more, the more matches there are.

    Where the direction is far from certain, what the matches tell depends on which pose is the
    right one: a rotation that is a little off lengthens all flow, and makes believe that it tells
    more. Then the covariance is that of all the poses that it allows, on average.
    """
    heard = _heard(fit)
    whole, noise, scatter = _told(matches, fit)
    covariance, shows_direction = _sandwich(whole, noise, heard * scatter + (1.0 - heard) * whole)
    if shows_direction and np.trace(covariance[3:, 3:]) > STRAIGHT_SIGMA**2:
        covariance = _averaged(matches, fit, covariance)
    return covariance, shows_direction


def _heard(fit: MovingFit) -> float:
    """How much the scatter of the residuals counts, of 1."""
    right = float(fit.probability.sum())
    return right / (right + STATED)


def _told(matches: Matches, fit: MovingFit) -> np.ndarray:
    """Gauss-Newton matrix, the share of it that is noise, and scatter of the gradient (3, 5, 5).

    The first two lack the information that is lost for not knowing which matches are good. The
    noise is estimated too, from few matches roughly: on average its inverse is too large by
    ``f / (f - 2)`` with f degrees of freedom, and the covariance is made larger by as much. The
    scatter along one axis is that of some matches only: as far as it is heard, by ``f / (f - 5)``.
    """
    told = np.empty((3, 5, 5))
    known = information(*_seen(matches, fit), *told)
    told *= _sure(fit)
    told[:2] *= known
    return told


def _seen(matches: Matches, fit: MovingFit) -> tuple:
    """Matches, what is plausible of them, pose and noise, as `information` takes them."""
    clutter = clutter_density(fit.noise.variance, fit.noise.wrong, matches.spread)
    pose = fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    return matches.pairs, fit.prior, *pose, fit.noise.array, clutter


def _sure(fit: MovingFit) -> float:
    """What is left of the information for having estimated the noise and the scatter, too."""
    freedom = max(float(fit.probability.sum()) - 5.0, 4.0)
    return (freedom - 2.0 - 3.0 * _heard(fit)) / freedom


def _sandwich(
    whole: np.ndarray, noise: np.ndarray, variance: np.ndarray
) -> tuple[np.ndarray, bool]:
    """``H^-1 V H^-1`` with ``H = whole - noise``, and whether H has signal enough along every axis.

    Where nearly all of the Gauss-Newton matrix is noise, it alone tells the scale, by the least
    share of it that is taken to be signal.
    """
    whole = whole + DIRECTION_PRIOR
    covariance = np.empty((5, 5))
    if sandwich(whole, noise, variance + DIRECTION_PRIOR, SIGNAL, covariance):
        return positive(covariance), True
    if not (np.isfinite(whole).all() and np.isfinite(noise).all()):
        return np.full((5, 5), np.inf), False
    # In the axes in which V is the identity, H is what is left of it without the share of noise.
    whiten = inverse_root(whole)
    share, vectors = np.linalg.eigh(whiten.T @ noise @ whiten)
    root = whiten @ vectors / np.clip(1.0 - share, LEAST_SIGNAL, 1.0)
    return positive(root @ root.T), False


def _averaged(matches: Matches, fit: MovingFit, covariance: np.ndarray) -> np.ndarray:
    """A covariance, and how much larger it is on average at the poses that it allows.

    To second order: half of what it changes by, at a sigma to either side along its two widest
    axes. The residuals there are not those of a fit, and are not heard.
    """
    values, axes = np.linalg.eigh(covariance)
    sigmas = axes * np.sqrt(values)
    widest, second = sigmas.T[:2:-1]
    growth = -2.0 * _beside(matches, fit, covariance, NO_STEP)
    for step in (widest, -widest, second, -second):
        growth += 0.5 * _beside(matches, fit, covariance, step)
    per_sigma = axes / np.sqrt(values)
    more, along = np.linalg.eigh(per_sigma.T @ growth @ per_sigma)
    root = sigmas @ along * np.sqrt(1.0 + np.clip(more, 0.0, MOST_GROWTH))
    return positive(root @ root.T)


def _beside(
    matches: Matches, fit: MovingFit, covariance: np.ndarray, step: np.ndarray
) -> np.ndarray:
    """Covariance (5, 5) if the right pose is ``step`` (5,) beside that of the fit.

    Very large where hardly anything is signal then.
    """
    there = np.empty((5, 5))
    if covariance_beside(*_seen(matches, fit), _sure(fit), SIGNAL, step, there):
        return there
    return (1.0 + MOST_GROWTH) * covariance


def shared_covariance(matches: Matches, sigma: float) -> np.ndarray:
    """Covariance (3, 3), rad^2, of a rotation by which all matches are off alike, by ``sigma``.

    As large as the rotation that moves a typical match by ``sigma``, in units of the noise.
    """
    if sigma == 0.0:
        return np.zeros((3, 3))
    per_unit = 0.5 * float(np.median(1.0 / matches.precision))  # rad^2; both images have noise
    return sigma**2 * per_unit * np.eye(3)
