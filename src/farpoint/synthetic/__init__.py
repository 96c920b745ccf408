"""Scenes whose truth is known exactly: point sets, and rendered images."""

from farpoint.synthetic.bound import cramer_rao_bound, rotation_cramer_rao_bound
from farpoint.synthetic.paper import (
    PAPER_NOISE_PX,
    PAPER_OUTLIERS,
    paper_camera,
    paper_example,
    paper_protocol,
)
from farpoint.synthetic.points import (
    OutlierKind,
    PointScene,
    PointSceneOptions,
    make_point_scene,
)

__all__ = [
    "PAPER_NOISE_PX",
    "PAPER_OUTLIERS",
    "OutlierKind",
    "PointScene",
    "PointSceneOptions",
    "cramer_rao_bound",
    "make_point_scene",
    "paper_camera",
    "paper_example",
    "paper_protocol",
    "rotation_cramer_rao_bound",
]
