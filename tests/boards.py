"""A scene of textured boards whose images are known exactly, and a drive past it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from farpoint import Camera
from farpoint.geometry import so3

WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
K = np.array([[FOCAL, 0.0, 159.5], [0.0, FOCAL, 119.5], [0.0, 0.0, 1.0]])
CAMERA = Camera.pinhole(WIDTH, HEIGHT, FOCAL, FOCAL, 159.5, 119.5)
TURN = so3.exp(np.array([0.002, 0.008, -0.003]))
STEP = np.array([-0.05, 0.01, -0.03])


class Boards:
    """Upright boards, near ones in front of a wall so far that it only turns, seen from anywhere.

    Each board is a texture on the plane Z = depth of camera 0, so its image in another camera is a
    homography: ``K (R + t n^T / depth) K^-1``.
    """

    def __init__(self, seed: int) -> None:
        self._rng = rng = np.random.default_rng(seed)
        self.layers = [
            (depth, mask, self._texture(rng))
            for depth, mask in [
                (1e6, np.ones((2 * HEIGHT, 2 * WIDTH))),
                (5.0, self._rows(0.62, 1.0, 0.0, 1.0)),
                (3.0, self._rows(0.0, 0.75, 0.0, 0.42)),
                (2.0, self._rows(0.3, 0.9, 0.62, 1.0)),
            ]
        ]

    @staticmethod
    def _texture(rng: np.random.Generator) -> np.ndarray:
        noise = rng.normal(size=(2 * HEIGHT, 2 * WIDTH))
        smooth = gaussian_filter(noise, 1.6) + 4.0 * gaussian_filter(noise, 6.0)
        return spline_filter(128 + 35 * smooth / smooth.std(), order=3)

    @staticmethod
    def _rows(top: float, bottom: float, left: float, right: float) -> np.ndarray:
        mask = np.zeros((2 * HEIGHT, 2 * WIDTH))
        rows = slice(round(2 * HEIGHT * top), round(2 * HEIGHT * bottom))
        mask[rows, round(2 * WIDTH * left) : round(2 * WIDTH * right)] = 1
        # Soft edges, that they move by fractions of a pixel.
        return gaussian_filter(mask, 1.0)

    def seen(self, R_cam_from_cam0: np.ndarray, t: np.ndarray) -> np.ndarray:
        """The image from a camera, with noise of two grey levels."""
        rows, columns = np.mgrid[:HEIGHT, :WIDTH]
        pixels = np.stack([columns.ravel(), rows.ravel(), np.ones(rows.size)])
        image = np.zeros(rows.size)
        for depth, mask, texture in self.layers:
            plane = np.outer(t, [0.0, 0.0, 1.0 / depth])
            x, y, w = np.linalg.solve(K @ (R_cam_from_cam0 + plane) @ np.linalg.inv(K), pixels)
            # A texture is twice the image, centred on it. (OpenCV warps by 1/32 px: too coarse.)
            at = np.stack([y / w + HEIGHT / 2, x / w + WIDTH / 2])
            cover = map_coordinates(mask, at, order=1)
            image += cover * (map_coordinates(texture, at, order=3, prefilter=False) - image)
        noise = self._rng.normal(0.0, 2.0, image.shape)
        return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8).reshape(HEIGHT, WIDTH)


def drive(count: int, R: np.ndarray = TURN, t: np.ndarray = STEP, seed: int = 3):
    """Images of a camera that makes the same motion again and again."""
    boards = Boards(seed)
    R_cam_from_cam0, position = np.eye(3), np.zeros(3)
    images = []
    for _ in range(count):
        images.append(boards.seen(R_cam_from_cam0, position))
        R_cam_from_cam0, position = R @ R_cam_from_cam0, R @ position + t
    return images
