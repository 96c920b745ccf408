"""Do neighbouring tracks of a video err alike, and are its covariances too small for it?

Prints the correlation of the tracks' errors by their distance, and the split-half test with the
tracks dealt by 16 parts of the image and by image cells, in which errors that neighbours share do
not cancel.

The error of a track is its distance from the epipolar line of the estimated motion, over the sigma
that its covariance predicts. Covariances of motions take those errors as independent.

    python examples/shared_errors.py drive.mp4 --camera camera.yaml
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import farpoint as fp
from farpoint.metrics import SplitHalf, evaluate_halves

EDGES_PX = np.array([0, 12, 16, 24, 32, 48, 64, 96, 128])
CELLS_PX = (None, 64, 128)
GOOD_SIGMAS = 4.0  # errors beyond are wrong matches


def errors(result: fp.OdometryResult, camera: fp.Camera) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 2), px, of the tracks that agree with the motion; their errors (N,), in sigma."""
    pose = result.pose
    R, t = pose.rotation_cam1_from_cam0, pose.direction_cam1_from_cam0
    good = result.tracks.select(pose.labels != fp.TrackLabel.OUTLIER)
    a, b = camera.unproject(good.points0), camera.unproject(good.points1)
    by_b = np.cross(t, a @ R.T)  # derivatives of b . (t x R a) by the two rays
    by_a = np.cross(b, t) @ R
    half = 0.5 * good.covariance_px2  # either image's share
    variance = np.zeros(len(good))
    for by_ray, rays in ((by_a, a), (by_b, b)):
        by_pixel = np.einsum("ni,nij->nj", by_ray, camera.unproject_jacobian(rays))
        variance += np.einsum("ni,nij,nj->n", by_pixel, half, by_pixel)
    return good.points0, np.sum(b * by_b, axis=1) / np.sqrt(variance)


class Correlation:
    """Of errors of two tracks of a pair of frames, by the distance between them."""

    def __init__(self) -> None:
        self.ratios: list[float] = []
        self._sums = np.zeros(len(EDGES_PX) - 1)
        self._counts = np.zeros(len(EDGES_PX) - 1)

    def add(self, points: np.ndarray, error: np.ndarray) -> None:
        """Take in the tracks of one pair of frames."""
        self.ratios.append(1.4826 * float(np.median(np.abs(error))))
        keep = np.abs(error) < GOOD_SIGMAS * self.ratios[-1]
        points, error = points[keep], error[keep] / np.sqrt(np.mean(error[keep] ** 2))
        i, j = np.triu_indices(len(points), 1)
        distance = np.linalg.norm(points[i] - points[j], axis=1)
        self._sums += np.histogram(distance, EDGES_PX, weights=error[i] * error[j])[0]
        self._counts += np.histogram(distance, EDGES_PX)[0]

    def __str__(self) -> str:
        found = self._sums / np.maximum(self._counts, 1.0)
        rows = [
            f"{low:>5} - {high:<4} {r:6.3f}"
            for low, high, r in zip(EDGES_PX, EDGES_PX[1:], found, strict=False)
        ]
        head = f"error over predicted sigma, median {np.median(self.ratios):.2f}"
        return "\n".join([head, "distance, px: correlation", *rows])


def main() -> None:
    """Run over a video, and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source")
    parser.add_argument("--camera", type=Path, required=True)
    arguments = parser.parse_args()
    odometry = fp.Odometry(fp.load_camera(arguments.camera))
    correlation = Correlation()
    halves: dict[float | None, list[SplitHalf]] = {cell_px: [] for cell_px in CELLS_PX}
    for result in odometry.run(fp.open_frames(arguments.source)):
        if result.pose is None:
            continue
        if result.pose.status is fp.PoseStatus.OK:
            correlation.add(*errors(result, odometry.camera))
        for cell_px, found in halves.items():
            found.append(odometry.split_half(result, cell_px=cell_px))
    print(correlation)
    for cell_px, found in halves.items():
        pose = evaluate_halves(found).pose
        dealt = "by parts of the image" if cell_px is None else f"by cells of {cell_px} px"
        print(
            f"halves dealt {dealt}: {pose.count} compared, sigma over difference "
            f"{pose.sigma_over_error:.2f}, in 95 % {pose.coverage95.share:.2f}"
        )


if __name__ == "__main__":
    main()
