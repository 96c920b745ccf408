"""What holds for every lens model, whatever its equations: shared by the tests of each."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera


def pixel_grid(size: tuple[int, int], steps: int = 60) -> np.ndarray:
    """Pixels (N, 2) over the whole image, its borders included."""
    width, height = size
    u, v = np.meshgrid(
        np.linspace(-0.5, width - 0.5, steps), np.linspace(-0.5, height - 0.5, steps)
    )
    return np.column_stack([u.ravel(), v.ravel()])


def whole_rows_are_nan(rows: np.ndarray) -> bool:
    missing = np.isnan(rows).reshape(len(rows), -1)
    return bool(np.all(missing.any(axis=1) == missing.all(axis=1)))


def round_trip_px(camera: Camera) -> tuple[float, float]:
    """Largest error of pixel -> ray -> pixel where a ray exists, and the share of such pixels."""
    assert camera.size is not None
    pixels = pixel_grid(camera.size)
    rays = camera.unproject(pixels)
    assert rays.dtype == np.float64
    assert whole_rows_are_nan(rays)
    seen = np.isfinite(rays[:, 0])
    np.testing.assert_allclose(np.linalg.norm(rays[seen], axis=1), 1.0, rtol=0, atol=1e-14)
    back = camera.project(rays[seen])
    return float(np.abs(back - pixels[seen]).max()), float(seen.mean())


def project_jacobian_by_differences(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Central differences of `project`, shape (N, 2, 3)."""
    step = 1e-6
    columns = []
    for axis in np.eye(3):
        ahead, behind = camera.project(points + step * axis), camera.project(points - step * axis)
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, axis=-1)


def unproject_jacobian_by_differences(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Central differences of `unproject`, shape (N, 3, 2)."""
    step = 1e-3
    columns = []
    for axis in np.eye(2):
        ahead, behind = (
            camera.unproject(pixels + step * axis),
            camera.unproject(pixels - step * axis),
        )
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, axis=-1)


def assert_jacobians_hold(camera: Camera, pixels: np.ndarray, tolerance: float = 1e-6) -> None:
    """Both Jacobians against central differences, at pixels that have a ray."""
    rays = camera.unproject(pixels)
    depths = np.linspace(0.5, 3.0, len(rays))[:, None]
    analytic = camera.model.project_jacobian(rays * depths)
    numeric = project_jacobian_by_differences(camera, rays * depths)
    scale = np.abs(numeric).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(analytic / scale, numeric / scale, rtol=0, atol=tolerance)

    analytic, numeric = (
        camera.unproject_jacobian(rays),
        unproject_jacobian_by_differences(camera, pixels),
    )
    scale = np.abs(numeric).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(analytic / scale, numeric / scale, rtol=0, atol=tolerance)
