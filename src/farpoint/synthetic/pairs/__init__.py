"""Pairs of views on which estimators fail: one generator for each known difficulty.

`KINDS` maps names to generators with typical arguments. A generator takes a seed; the same seed
gives the same pair.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from farpoint.camera import Camera
from farpoint.geometry import sphere
from farpoint.synthetic.pairs.mismatched import court, junk, rails, road, wide_baseline
from farpoint.synthetic.pairs.moving_objects import crossing, stationary, traffic
from farpoint.synthetic.pairs.pair import HardPair
from farpoint.synthetic.pairs.planes import floor, ground_below, rough_wall, wall, wall_ahead
from farpoint.synthetic.pairs.weak import (
    few,
    mostly_far,
    pure_rotation,
    short,
    smooth_errors,
    smooth_field,
)
from farpoint.synthetic.paper import paper_camera
from farpoint.synthetic.points import PointScene, PointSceneOptions, make_point_scene

__all__ = [
    "KINDS",
    "HardPair",
    "court",
    "crossing",
    "few",
    "floor",
    "ground_below",
    "junk",
    "mostly_far",
    "pure_rotation",
    "rails",
    "road",
    "rough_wall",
    "short",
    "smooth_errors",
    "smooth_field",
    "stationary",
    "traffic",
    "wall",
    "wall_ahead",
    "wide_baseline",
]

_WIDE = Camera.pinhole(1280, 960, 500.0, 500.0, 639.5, 479.5)


def _through_dirt(seed: int, share: float) -> HardPair:
    """Near and far points through a dirty lens, and a translation of 10 cm in a random direction.

    The share ``share`` of the matches stands still in the image.
    """
    direction = np.random.default_rng([seed, 29]).normal(size=3)
    options = PointSceneOptions(
        camera=paper_camera(),
        matches=300,
        outliers=15,
        rotation_vector_rad=(0.02, 0.05, -0.03),
        translation_m=tuple(0.1 * sphere.normalize(direction)),
    )
    return stationary(make_point_scene(options, seed=seed), seed, share=share)


KINDS: dict[str, Callable[[int], HardPair | PointScene]] = {
    "traffic, 20 % by 3 px": partial(traffic, share=0.2, shift_px=3.0),
    "traffic, 30 % by 3 px": partial(traffic, share=0.3, shift_px=3.0),
    "traffic, 40 % by 6 px": partial(traffic, share=0.4, shift_px=6.0),
    "object crossing, 10 %, camera at rest": partial(crossing, share=0.1, at_rest=True),
    "object crossing, 20 %, camera at rest": partial(crossing, share=0.2, at_rest=True),
    "object crossing, 20 %": partial(crossing, share=0.2, at_rest=False),
    "object crossing, 40 %": partial(crossing, share=0.4, at_rest=False),
    "dirt on the lens, 20 %": partial(_through_dirt, share=0.2),
    "dirt on the lens, 40 %": partial(_through_dirt, share=0.4),
    "wall, step aside": partial(wall, direction=(1.0, 0.0, 0.0)),
    "wall, step back": partial(wall, direction=(-0.84, 0.11, -0.53)),
    "wall, 3 points before it": partial(wall, direction=(0.84, -0.11, 0.53), off_plane=3),
    "rough wall, 40 matches, 20 % wrong": partial(
        rough_wall, matches=40, relief=0.005, outlier_share=0.2
    ),
    "rough wall, 300 matches": partial(rough_wall, matches=300, relief=0.005),
    "wall ahead, 90 matches": partial(wall_ahead, matches=90, relief=0.0),
    "wall ahead, 300 matches, relief": partial(wall_ahead, matches=300, relief=0.02),
    "floor": floor,
    "ground straight below": ground_below,
    "rails": rails,
    "road, half of the matches wrong": road,
    "court, 40 % repeated": partial(court, matches=150, repeated=0.4),
    "court, windows repeated": partial(court, matches=500, repeated=0.5, whole=True),
    "wide baseline, 60 % wrong": partial(
        wide_baseline, camera=_WIDE, baseline_m=0.5, turn_deg=30.0, matches=160, outliers=96
    ),
    "wrong matches alone": junk,
    "mostly far": mostly_far,
    "short step": short,
    "short step, 20 % wrong": partial(short, outliers=18),
    "15 matches, 4 wrong": few,
    "turn, half of the matches wrong": partial(pure_rotation, outliers=55),
    "smooth errors": partial(smooth_errors, baseline_m=0.3),
    "smooth errors, turn": partial(smooth_errors, baseline_m=0.0),
}
