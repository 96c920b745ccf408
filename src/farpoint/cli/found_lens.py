"""Table of estimated and true values of lens and shutter."""

from __future__ import annotations

import json
from pathlib import Path

from farpoint.camera import Camera

__all__ = ["found_lens_text"]

_HEAD = ("lens and shutter", "given", "found", "sigma", "true", "error/sigma")


def found_lens_text(folder: Path, true: Camera, readout_s: float) -> str:
    """Table of the lens parameters that a run into ``folder`` estimated, and the read-out time.

    Parameters
    ----------
    folder : Path
        Folder with the ``run.json`` of the run.
    true : Camera
        True camera, which took the images.
    readout_s : float
        True read-out time of a frame from the first row to the last row, s.
    """
    lens = json.loads((folder / "run.json").read_text())["lens"]
    right = true.refinable.parameters
    rows = [
        _row(name, f"{lens['given'][name]:.5g}", found, lens["sigma"][name], right[name])
        for name, found in lens["found"].items()
    ]
    readout_ms, sigma_ms = (1e3 * lens[name] for name in ("readout_s", "readout_sigma_s"))
    rows.append(_row("read-out, ms", "-", readout_ms, sigma_ms, 1e3 * readout_s))
    cells = [_HEAD, *rows]
    widths = [max(len(row[column]) for row in cells) for column in range(len(_HEAD))]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if column else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    )


def _row(name: str, given: str, found: float, sigma: float, right: float) -> tuple[str, ...]:
    share = f"{(found - right) / sigma:.2f}" if sigma > 0.0 else "-"
    return (name, given, f"{found:.5g}", f"{sigma:.2g}", f"{right:.5g}", share)
