"""Draw the picture of the viewer in the documentation: ``python docs/window.py``, about a minute.

A run through the rendered street is recorded, opened in a Rerun viewer without a window, and
photographed in the middle of the bend. A machine without a graphics card needs Mesa's software
renderer.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from rerun.experimental import ViewerClient

from farpoint.camera import Camera
from farpoint.odometry import Odometry
from farpoint.sinks import ViewerOptions, open_viewer
from farpoint.synthetic import render_drive

PICTURE = Path(__file__).parent / "images" / "viewer.webp"
DASH = Camera.pinhole(640, 360, 490.0, 490.0, 319.5, 179.5)
FRAMES, SHOWN_S = 60, 4.6
ADDRESS, PORT, SIZE = "127.0.0.1", 9877, "1500x940"
MENU_PX = 37  # what stands there is of the machine that draws
PATIENCE_S = 60.0
SETTLED_S = 12.0  # by then all is painted, and the viewer's own messages have gone
QUALITY = 88


def record(path: Path) -> None:
    """Record the display of a drive."""
    display = open_viewer(ViewerOptions(rrd=path), "drive", DASH)
    odometry, drive = Odometry(DASH), render_drive(DASH, frames=FRAMES, seed=1)
    for frame in drive:
        display.write(odometry.process(frame.image, frame.timestamp), frame.image)
    display.close()


def photograph(recording: Path) -> np.ndarray:
    """The viewer's window below its menu."""
    command = [sys.executable, "-m", "rerun_cli", "--headless", "--bind", ADDRESS]
    process = subprocess.Popen(
        [*command, "--port", str(PORT), "--window-size", SIZE, "--hide-welcome-screen"],
        env={**os.environ, "CI": "true"},  # without statistics
        stderr=subprocess.DEVNULL,
    )
    try:
        viewer = connected()
        viewer.open(str(recording))
        viewer.set_time("time", duration=SHOWN_S, play_state="paused")
        time.sleep(SETTLED_S)
        png = viewer.take_screenshot(max_size=int(SIZE.partition("x")[0]))
    finally:
        process.terminate()
        process.wait()
    window = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert window is not None
    return window[MENU_PX:]


def connected() -> ViewerClient:
    """The viewer, once it answers."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            viewer = ViewerClient.connect(f"rerun+http://{ADDRESS}:{PORT}/proxy")
            viewer.get_state()
        except Exception:  # in whatever words it says that it is not there yet
            if time.monotonic() > end_s:
                raise
            time.sleep(0.5)
        else:
            return viewer


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "drive.rrd"
        record(recording)
        picture = photograph(recording)
    cv2.imwrite(str(PICTURE), picture, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])


if __name__ == "__main__":
    main()
