"""``farpoint demo``: a drive with exact truth, through everything."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from farpoint.camera import Camera
from farpoint.cli.run import process_frames
from farpoint.errors import InputError
from farpoint.evaluate import evaluate_folder
from farpoint.metrics import to_text
from farpoint.odometry import OdometryOptions
from farpoint.sinks import FolderLock, OutputOptions
from farpoint.sinks.files import replacing
from farpoint.sinks.report import write_report

__all__ = ["Demo"]

# A dash camera: 640 x 360 pixels, 66 degrees wide.
CAMERA = Camera.pinhole(640, 360, 490.0, 490.0, 319.5, 179.5)


@dataclass(frozen=True, kw_only=True)
class Demo:
    """Render a drive with exact truth, run everything on it, and print the errors.

    Attributes
    ----------
    out : Path
        Folder for the outputs.
    frames : int
        Length of the drive.
    seed : int
        Of the street, the drive and the estimator.
    output : OutputOptions
        Which outputs are made.
    """

    out: Path = Path("farpoint-out/demo")
    frames: int = 100
    seed: int = 1
    output: Annotated[OutputOptions, tyro.conf.arg(name="")] = field(default_factory=OutputOptions)

    def __call__(self) -> None:
        """Do it."""
        if self.frames < 3:
            raise InputError(f"expected at least 3 frames, got {self.frames}", field="frames")
        if self.seed < 0:
            raise InputError(f"expected 0 or more, got {self.seed}", field="seed")
        # Loaded on use: the other commands need not wait for the renderer.
        from farpoint.synthetic import render_drive

        drive = render_drive(CAMERA, frames=self.frames, seed=self.seed)
        source = f"rendered drive, seed {self.seed}"
        options = OdometryOptions(seed=self.seed)
        with FolderLock(self.out) as lock:
            process_frames(drive, source, CAMERA, self.out, options, self.output, lock=lock)
            truth = self.out / "truth.tum"
            with replacing(truth) as part:
                drive.write_truth(part)
            found = evaluate_folder(self.out, truth)
            print(f"\nagainst the exact truth in {truth}:\n")
            print(to_text(found.evaluation))
            if self.output.report:
                write_report(self.out, truth)
        print(_what_to_look_at(self.out, self.output))


def _what_to_look_at(out: Path, output: OutputOptions) -> str:
    """Last words: which files to open, and what to see in each."""
    far, near = output.palette.split("-")
    words = []
    if output.overlay:
        words.append(f"""
Open {out / "overlay.mp4"}: points so far away that only the rotation moves them are
{far}, points that carry the translation {near}. On the right the rotation is taken out: what
is left of the flow points away from the circle with the cross, the epipole. The camera
travels there; in 95 of 100 frames the true place is inside the ellipse around it.""")
    if output.report:
        words.append(f"""
Open {out / "report.html"} in a browser: point at a curve to see the frame of that
moment. In the bend the 1-sigma of the direction rises: farpoint is less sure there, and
says so. "Path from above" shows the true path beside the estimated one.""")
    words.append(f"\nEvery motion with its covariance is a row of {out / 'motions.csv'}.")
    return "\n".join(words)
