"""One lens of each kind, for the tests of what all lenses must hold."""

from __future__ import annotations

from farpoint.camera import (
    Arctangent,
    CameraModel,
    Division,
    DoubleSphere,
    Equirectangular,
    ExtendedUnified,
    KannalaBrandt,
    Pinhole,
    Scaramuzza,
    Unified,
)

CENTRE = {"cx": 318.7, "cy": 241.3}
FOCAL = {"fx": 251.5, "fy": 249.2, **CENTRE}
# The focal lengths of a sphere model grow with the distance of its pinhole.
FAR_FOCAL = {"fx": 610.5, "fy": 607.2, **CENTRE}
D4 = (-0.21, 0.06, 8e-4, -5e-4)

SYMMETRIC: dict[str, CameraModel] = {
    "pinhole": Pinhole(**FOCAL),
    "pinhole radtan": Pinhole(**FOCAL, distortion=(-0.02, 0.003, 0, 0)),
    "kannala-brandt": KannalaBrandt(**FOCAL, k1=0.003, k2=7e-4, k3=-0.002, k4=2e-4),
    "eucm": ExtendedUnified(**FOCAL, alpha=0.63, beta=1.04),
    "double sphere": DoubleSphere(**FOCAL, xi=-0.17, alpha=0.59),
    "unified, weak": Unified(**FOCAL, xi=0.4),
    "unified, parabolic": Unified(**FOCAL, xi=1.0),
    "unified, strong": Unified(**FAR_FOCAL, xi=2.2),
    "arctangent": Arctangent(**FOCAL, omega=0.93),
    "division, barrel": Division(**FOCAL, k=-0.24),
    "division, pincushion": Division(**FOCAL, k=0.11),
    "scaramuzza fisheye": Scaramuzza(
        coefficients=(-206.5, 0.0, 2.2e-3, -4.9e-6, 1.87e-8), **CENTRE
    ),
    "scaramuzza, first order": Scaramuzza(coefficients=(-206.5, 0.1, 1.2e-3), **CENTRE),
    "scaramuzza, endless": Scaramuzza(coefficients=(-206.5,), **CENTRE),
}
OTHERS: dict[str, CameraModel] = {
    "mei": Unified(**FAR_FOCAL, xi=1.7, distortion=D4, skew=0.4),
    "mei, weak": Unified(**FOCAL, xi=0.8, distortion=D4),
    "scaramuzza, affine": Scaramuzza(
        coefficients=(-206.5, 0.0, 2.2e-3, -4.9e-6, 1.87e-8), **CENTRE, c=1.002, d=3e-3, e=-2e-3
    ),
    "equirectangular": Equirectangular(width=640, height=480),
}
LENSES = SYMMETRIC | OTHERS
