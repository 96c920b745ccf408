"""A camera attached to this machine, opened by OpenCV."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

from farpoint.errors import InputError, optional_import
from farpoint.frames.decode import silent_opencv
from farpoint.frames.frame import Frame

__all__ = ["CameraDevice", "open_device"]


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraDevice:
    """An open camera, which can be iterated once, until the camera is unplugged.

    The time stamp of a picture is the wall-clock time, s, at which the picture was fetched.
    """

    name: str
    capture: Any
    count: int | None = None
    timestamp_source: str = "wall clock"
    calibration_path: Path | None = None
    notes: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[Frame]:
        """Frames of the camera; the last frame has a fault."""
        cv2 = optional_import("cv2", extra="video", purpose="reading a camera")
        try:
            for index in count():
                with silent_opencv():
                    delivered, image = self.capture.read()
                now, name = time.time(), str(index)
                if not delivered:
                    fault = "the camera delivers no more pictures"
                    yield Frame(index=index, timestamp=now, image=None, name=name, fault=fault)
                    return
                grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
                yield Frame(index=index, timestamp=now, image=grey, name=name)
        finally:
            self.capture.release()


def open_device(index: int) -> CameraDevice:
    """Open the camera of this index.

    Raises
    ------
    InputError
        If there is no such camera, or if another program uses the camera.
    """
    cv2 = optional_import("cv2", extra="video", purpose="reading a camera")
    with silent_opencv():
        capture = cv2.VideoCapture(index)
    if not capture.isOpened():
        raise InputError(f"no camera of index {index} can be opened", field="source")
    return CameraDevice(name=f"camera{index}", capture=capture)
