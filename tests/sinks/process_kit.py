"""Sinks that another process can import."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import numpy as np

from farpoint.errors import InputError
from farpoint.odometry import OdometryResult


class Notes:
    """Writes a line for each call: which process, and what came."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._note("open")

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        self._note(f"frame {result.frame1} {None if image is None else int(image.sum())}")

    def tell(self, what: str, number: int) -> None:
        self._note(f"told {what} {number}")

    def close(self) -> None:
        self._note("close")

    def _note(self, words: str) -> None:
        with self._path.open("a") as file:
            file.write(f"{os.getpid()} {words}\n")


class Loud(Notes):
    """Prints, and reads what nobody wrote to it."""

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        print("drawing", flush=True)
        os.write(1, b"and again")
        assert sys.stdin.read() == ""
        super().write(result, image)


class Slow(Notes):
    """Takes its time."""

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        time.sleep(600.0 if result.frame1 else 0.0)
        super().write(result, image)


class FullDisk(Notes):
    """Cannot write the second frame."""

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        if result.frame1 == 1:
            raise OSError(28, "No space left on device", "film.mp4")
        super().write(result, image)


class Unpicklable(Notes):
    """Raises what cannot be sent."""

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        class OwnError(Exception):
            pass

        del result, image
        raise OwnError("of its own kind")


def refused() -> Notes:
    raise InputError("cannot be written", file="film.mp4", field="--out")


def exits() -> Notes:
    os._exit(3)
