"""farpoint and the installed peers (other libraries for relative pose), with one interface."""

from __future__ import annotations

from importlib import metadata

from farpoint.bench.estimators.colmap_peer import colmap_estimators
from farpoint.bench.estimators.estimator import Estimator, Motion, load_peer, pinhole_points
from farpoint.bench.estimators.magsac_peer import magsac_estimators
from farpoint.bench.estimators.opencv_peer import opencv_estimators
from farpoint.bench.estimators.own import CLOSED_FORM, FARPOINT
from farpoint.bench.estimators.poselib_peer import poselib_estimators

__all__ = [
    "CLOSED_FORM",
    "FARPOINT",
    "Estimator",
    "Motion",
    "all_estimators",
    "load_peer",
    "peer_versions",
    "pinhole_points",
]

_PEERS = {
    "PoseLib": "poselib",
    "pycolmap": "pycolmap",
    "OpenCV": "cv2",
    "MAGSAC++": "pymagsac",
    "GC-RANSAC": "pygcransac",
}


def all_estimators() -> tuple[Estimator, ...]:
    """All available estimators: farpoint first, then the peers that are installed."""
    return (
        FARPOINT,
        *poselib_estimators(),
        *colmap_estimators(),
        *opencv_estimators(),
        *magsac_estimators(),
    )


def peer_versions() -> dict[str, str | None]:
    """Version of each peer; None if not installed."""
    return {name: _version(module) for name, module in _PEERS.items()}


def _version(module: str) -> str | None:
    loaded = load_peer(module)
    if loaded is None:
        return None
    # PoseLib keeps its version in the metadata alone.
    return getattr(loaded, "__version__", None) or metadata.version(module)
