"""Search for a calibration file near the images. The file is named in messages but not used."""

from __future__ import annotations

from pathlib import Path

from farpoint.frames.files import natural_key

__all__ = ["find_calibration"]

# The most specific names come first: KITTI, EuRoC, Kalibr, then other common names.
_PATTERNS = (
    "calib.txt",
    "sensor.yaml",
    "cam0_sensor.yaml",
    "calib_cam_to_cam.txt",
    "camchain*.yaml",
    "*calib*.yaml",
    "*calib*.yml",
    "*calib*.json",
    "camera*.yaml",
    "camera*.yml",
    "camera*.json",
    "left*sensor*.yaml",
    "intrinsics*.*",
    "K.txt",
    "cameras.txt",
)


def find_calibration(*folders: Path, stem: str | None = None) -> Path | None:
    """First file in `folders`, or in subfolders ``calib``, that has the name of a calibration.

    Parameters
    ----------
    *folders : Path
        Folders to search, nearest first.
    stem : str, optional
        Name of a video without suffix. A YAML or JSON file of the same name comes first.
    """
    named = () if stem is None else tuple(f"{stem}{end}" for end in (".yaml", ".yml", ".json"))
    for place in (place for folder in folders for place in (folder, folder / "calib")):
        files = sorted((file.name for file in place.glob("*") if file.is_file()), key=natural_key)
        for name in named:
            if name in files:
                return place / name
        for pattern in _PATTERNS:
            for name in files:
                if Path(name).match(pattern):
                    return place / name
    return None
