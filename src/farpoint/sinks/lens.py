"""Estimates of lens and shutter, as plain values for ``run.json``."""

from __future__ import annotations

from typing import Any

from farpoint.odometry import LensReport

__all__ = ["lens_facts"]


def lens_facts(lens: LensReport) -> dict[str, Any]:
    """Given and estimated parameters of the lens with sigmas, and the read-out time with its sigma.

    Returns
    -------
    dict
        Dicts ``given``, ``found`` and ``sigma`` with the parameters of the model, and the single
        values ``refined``, ``readout_s``, ``readout_sigma_s`` and ``moved_px`` (largest
        displacement of a pixel between given and estimated lens).
    """
    found = lens.camera.model.parameters
    given = {**dict.fromkeys(found, 0.0), **lens.given.model.refinable().parameters}
    return {
        "refined": lens.refined,
        "given": {name: float(given[name]) for name in found},
        "found": {name: float(value) for name, value in found.items()},
        "sigma": {name: float(lens.sigma.get(name, 0.0)) for name in found},
        "moved_px": lens.moved_px,
        "readout_s": lens.readout_s,
        "readout_sigma_s": lens.readout_sigma_s,
    }
