"""Effects of lens parameters on the image, from which priors of their errors are built."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Direction", "ParameterRoles"]

Direction = dict[str, float]
"""Changes of parameters by name; parameters that are not named do not change."""


@dataclass(frozen=True, kw_only=True)
class ParameterRoles:
    """The parameters of a lens by their effect on the image. A parameter without a role is exact.

    Attributes
    ----------
    scale : Direction
        Derivative of the parameters by the logarithm of the scale of the image about the centre.
    affine : tuple of Direction
        Derivatives of the parameters by the other affine deformations of the sensor: ratio of the
        sides, and shear.
    center : tuple of str
        Principal point or centre of distortion along x and y, px.
    radial : tuple of str
        Parameters that move pixels towards the centre or away from the centre, lowest order first.
    decentering : tuple of str
        Parameters of other distortions: tangential, thin prism, tilted sensor.
    """

    scale: Direction
    affine: tuple[Direction, ...]
    center: tuple[str, ...]
    radial: tuple[str, ...]
    decentering: tuple[str, ...] = ()
