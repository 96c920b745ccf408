"""``farpoint demo``: a rendered drive, or a walk with a phone, with known true motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from farpoint.camera import Camera
from farpoint.cli.found_lens import found_lens_text
from farpoint.cli.run import process_frames
from farpoint.errors import InputError
from farpoint.evaluate import evaluate_folder
from farpoint.metrics import to_text
from farpoint.odometry import OdometryOptions
from farpoint.sinks import FolderLock, OutputOptions
from farpoint.sinks.files import replacing
from farpoint.sinks.report import write_report

if TYPE_CHECKING:
    from farpoint.synthetic import RenderedSequence

__all__ = ["Demo"]

# A dash camera: 640 x 360 pixels, 66 degrees wide.
CAMERA = Camera.pinhole(640, 360, 490.0, 490.0, 319.5, 179.5)

# A phone: 65 degrees wide, 30 frames a second, read from top to bottom in 0.7 of a frame's time.
PHONE = Camera.pinhole(640, 360, 500.0, 500.0, 319.5, 179.5)
PHONE_FPS = 30.0
PHONE_READOUT_S = 0.7 / PHONE_FPS
_EXPOSURE_S = 0.004
_FOCAL_ERROR = 0.05  # of the focal length that farpoint is given
_FRAMES, _HANDHELD_FRAMES = 100, 60  # similar run time: a blurred frame is a mean of three


@dataclass(frozen=True, kw_only=True)
class Demo:
    """Render a drive or a walk with known true motion, estimate the motion, and print the errors.

    Attributes
    ----------
    out : Path
        Folder for the outputs.
    handheld : bool
        Render a walk with a handheld phone instead of a drive. The read-out time of the shutter is
        unknown, and the given focal length is wrong by 5 %.
    frames : int or None
        Number of frames; 100 by default, or 60 with handheld.
    seed : int
        Seed of the street, the drive and the estimator.
    output : OutputOptions
        Options of the outputs.
    """

    out: Path = Path("farpoint-out/demo")
    handheld: bool = False
    frames: int | None = None
    seed: int = 1
    output: Annotated[OutputOptions, tyro.conf.arg(name="")] = field(default_factory=OutputOptions)

    def __call__(self) -> None:
        """Run the command."""
        frames = self.frames
        if frames is None:
            frames = _HANDHELD_FRAMES if self.handheld else _FRAMES
        if frames < 3:
            raise InputError(f"expected at least 3 frames, got {frames}", field="frames")
        if self.seed < 0:
            raise InputError(f"expected 0 or more, got {self.seed}", field="seed")
        sequence = self._render(frames)
        kind = "handheld walk" if self.handheld else "drive"
        source = f"rendered {kind}, seed {self.seed}"
        options = OdometryOptions(seed=self.seed)
        with FolderLock(self.out) as lock:
            process_frames(
                sequence, source, sequence.given, self.out, options, self.output, lock=lock
            )
            truth = self.out / "truth.tum"
            with replacing(truth) as part:
                sequence.write_truth(part)
            found = evaluate_folder(self.out, truth)
            print(f"\nagainst the exact truth in {truth}:\n")
            print(to_text(found.evaluation))
            if self.handheld:
                print(found_lens_text(self.out, sequence.camera, PHONE_READOUT_S))
            if self.output.report:
                write_report(self.out, truth)
        print(_what_to_look_at(self.out, self.output, self.handheld))

    def _render(self, frames: int) -> RenderedSequence:
        # Imported on use: other commands do not need the renderer.
        from farpoint.synthetic import (
            ImagingOptions,
            Miscalibration,
            RenderedSequence,
            handheld_walk,
            render_drive,
        )

        if not self.handheld:
            return render_drive(CAMERA, frames=frames, seed=self.seed)
        return RenderedSequence(
            PHONE,
            handheld_walk(frames, PHONE_FPS, self.seed),
            seed=self.seed,
            imaging=ImagingOptions(
                readout_s=PHONE_READOUT_S, exposure_s=_EXPOSURE_S, exposure_samples=3
            ),
            name=f"handheld-{self.seed}",
            given=Miscalibration(focal_share=_FOCAL_ERROR).of(PHONE),
        )


_INSIDE = "in 95 of 100 frames the true place is inside the ellipse around it"
# Two-view estimates take the given lens as exact until the lens estimated over the path differs
# significantly.
_INSIDE_BY_HAND = """in how many frames the true place is inside the ellipse around it,
the row "direction" above: until lens and shutter are found, fewer than 95 of 100"""
_IN_THE_CURVE = """In the bend the 1-sigma of the direction rises: its direction is less
certain there. """


def _what_to_look_at(out: Path, output: OutputOptions, handheld: bool) -> str:
    """The last printed lines, which name the files to open and explain each of them."""
    far, near = output.palette.split("-")
    words = []
    if output.overlay:
        words.append(f"""
Open {out / "overlay.mp4"}: points so far away that only the rotation moves them are
{far}, points that carry the translation {near}. On the right the rotation is taken out: what
is left of the flow points away from the circle with the cross, the epipole. The camera
travels there; {_INSIDE_BY_HAND if handheld else _INSIDE}.""")
    if output.report:
        curve = "" if handheld else _IN_THE_CURVE
        words.append(f"""
Open {out / "report.html"} in a browser: point at a curve to see the frame of that
moment. {curve}"Path from above" shows the true path beside the estimated one.""")
    words.append(f"\nEvery motion with its covariance is a row of {out / 'motions.csv'}.")
    return "\n".join(words)
