"""Interface of sinks, which write results one by one and leave a valid file when closed."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import numpy as np

from farpoint.odometry import OdometryResult
from farpoint.sinks.files import AppendFile

__all__ = ["PathFile", "Posed", "Sink", "TextFile", "TextSink"]


class Sink(Protocol):
    """Receives results in the order of the frames."""

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Add the result of one frame; the image is None if the frame could not be decoded."""
        ...

    def close(self) -> None:
        """Finish the output; a second call does nothing."""
        ...


class TextFile:
    """A text file, written line by line.

    Parameters
    ----------
    path : Path
        The file; an existing file is replaced.
    header : str
        First text of the file.
    """

    def __init__(self, path: Path, header: str = "") -> None:
        self._file = AppendFile(path, header.encode())

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _put(self, text: str) -> None:
        self._file.append(text.encode())


class Posed(Protocol):
    """A pose of the path: a final pose, or the pose of a result."""

    @property
    def frame1(self) -> int:
        """Index of the frame."""
        ...

    @property
    def timestamp(self) -> float:
        """Time of the frame, s."""
        ...

    @property
    def segment(self) -> int:
        """Index of the segment of the path."""
        ...

    @property
    def world_from_cam(self) -> np.ndarray:
        """Pose (4, 4)."""
        ...

    @property
    def world_covariance(self) -> np.ndarray | None:
        """Covariance (7, 7) of pose and scale; None if unknown."""
        ...


class PathFile(TextFile):
    """A file with lines for each pose of the path."""

    def write(self, pose: Posed, image: np.ndarray | None = None) -> None:
        """Append the lines of one pose; the image is not used."""
        del image
        self._put(self.lines(pose))

    def lines(self, pose: Posed) -> str:
        """Lines of a pose, with line ends."""
        raise NotImplementedError


class TextSink(TextFile):
    """A sink that writes lines of text for each result."""

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Append the lines of one result; the image is not used."""
        del image
        self._put(self.lines(result))

    def lines(self, result: OdometryResult) -> str:
        """Lines of a result, with line ends."""
        raise NotImplementedError
