"""Synthetic scenes with exact ground truth: point sets and rendered images."""

from farpoint.synthetic.bound import cramer_rao_bound, rotation_cramer_rao_bound
from farpoint.synthetic.handheld import HandheldTracks
from farpoint.synthetic.imaging import ImagingOptions
from farpoint.synthetic.inertial import InertialPath, SimulatedImu
from farpoint.synthetic.miscalibration import Miscalibration
from farpoint.synthetic.motion import SmoothMotion
from farpoint.synthetic.paper import (
    PAPER_NOISE_PX,
    PAPER_OUTLIERS,
    paper_camera,
    paper_example,
    paper_protocol,
)
from farpoint.synthetic.paths import (
    carried,
    pure_rotation,
    sideways,
    standing_still,
    street_drive,
)
from farpoint.synthetic.points import (
    OutlierKind,
    PointScene,
    PointSceneOptions,
    make_point_scene,
)
from farpoint.synthetic.sequence import RenderedSequence, RenderedView, render_drive
from farpoint.synthetic.walk import HandheldOptions, handheld_walk

__all__ = [
    "PAPER_NOISE_PX",
    "PAPER_OUTLIERS",
    "HandheldOptions",
    "HandheldTracks",
    "ImagingOptions",
    "InertialPath",
    "Miscalibration",
    "OutlierKind",
    "PointScene",
    "PointSceneOptions",
    "RenderedSequence",
    "RenderedView",
    "SimulatedImu",
    "SmoothMotion",
    "carried",
    "cramer_rao_bound",
    "handheld_walk",
    "make_point_scene",
    "paper_camera",
    "paper_example",
    "paper_protocol",
    "pure_rotation",
    "render_drive",
    "rotation_cramer_rao_bound",
    "sideways",
    "standing_still",
    "street_drive",
]
