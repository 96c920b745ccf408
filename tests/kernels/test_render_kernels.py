"""A picture of few pixels against separate rays; also rendered without the compiler."""

from __future__ import annotations

import cv2
import numpy as np

from farpoint.camera import Camera
from farpoint.synthetic import ImagingOptions, RenderedSequence, street_drive

WIDTH, HEIGHT, FINER = 16, 12, 4


def small_view(scale: int) -> tuple[np.ndarray, np.ndarray, RenderedSequence]:
    """Grey values and depths of one field of view, on ``scale`` times as many pixels."""
    focal, shift = 0.8 * WIDTH * scale, 0.5 * (scale - 1)
    cx, cy = 0.5 * (WIDTH - 1) * scale + shift, 0.5 * (HEIGHT - 1) * scale + shift
    camera = Camera.pinhole(WIDTH * scale, HEIGHT * scale, focal, focal, cx, cy)
    drive = street_drive(2, seed=3)
    sequence = RenderedSequence(camera, drive, imaging=ImagingOptions(noise_grey=0.0))
    view = sequence.view(0)
    assert view.frame.image is not None
    return view.frame.image.astype(float), view.depth, sequence


def test_few_pixels_are_the_mean_of_many():
    coarse, depth, sequence = small_view(1)
    pixels = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1).reshape(-1, 2)
    distances = sequence.distances(0, pixels.astype(float))
    np.testing.assert_allclose(depth.ravel(), distances, rtol=1e-9)
    fine, _, _ = small_view(FINER)
    # The renderer's own filter: sigma of about half a pixel.
    blurred = cv2.GaussianBlur(fine, (0, 0), 0.5 * FINER)
    expected = blurred.reshape(HEIGHT, FINER, WIDTH, FINER)[:, 1:3, :, 1:3].mean(axis=(1, 3))
    aliased = fine[1::FINER, 1::FINER] - expected
    assert np.isinf(depth).any()  # sky
    assert np.std(coarse - expected) < 3.5
    assert np.std(aliased) > 3.5 * np.std(coarse - expected)
