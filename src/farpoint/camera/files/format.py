"""Interface of a calibration format: a module with these members."""

from __future__ import annotations

from typing import Protocol

from farpoint.camera.camera import Camera
from farpoint.camera.files.source import CalibrationFile

__all__ = ["CalibrationFormat"]


class CalibrationFormat(Protocol):
    """Members that the module of each calibration format has."""

    @property
    def TITLE(self) -> str:
        """Common name of the format."""
        ...

    @property
    def FIRST_IS_DEFAULT(self) -> bool:
        """Whether the first of several cameras is the default when no name is given."""
        ...

    def matches(self, file: CalibrationFile) -> bool:
        """Whether the file is of this format; also true for a faulty file of the format."""
        ...

    def names(self, file: CalibrationFile) -> list[str]:
        """Names of the cameras in the order of the file; at least one."""
        ...

    def read(self, file: CalibrationFile, name: str) -> Camera:
        """The camera of this name. An InputError names the file and the field at fault."""
        ...
