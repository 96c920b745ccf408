"""Options of aiding measurements: files and numbers."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

from farpoint.aiding.bag_topics import positions_of_topic, speeds_of_topic
from farpoint.aiding.kinds import (
    AidingMeasurement,
    CameraHeight,
    GnssPositions,
    KnownDistance,
    KnownSpeed,
)
from farpoint.aiding.tables import read_gnss, read_speeds
from farpoint.errors import InputError
from farpoint.frames.bags import Bag
from farpoint.options import coerce_positive

__all__ = ["HeightOptions", "MetricOptions"]


@dataclass(frozen=True, kw_only=True)
class HeightOptions:
    """Camera height, as an aiding measurement. If the height is given, the outputs are in metres.

    Attributes
    ----------
    height : float or None
        Height of the camera over flat ground, m. The camera must be approximately upright.
    height_sigma : float
        Relative 1-sigma of the height.
    """

    height: float | None = None
    height_sigma: float = 0.05

    def __post_init__(self) -> None:
        sigmas = (field.name for field in fields(self) if field.name.endswith("_sigma"))
        coerce_positive(self, *sigmas)

    def measurements(self) -> list[AidingMeasurement]:
        """The camera height as an aiding measurement; empty without a height.

        Raises
        ------
        InputError
            If the height is invalid. The message has the given value and the expected value.
        """
        if self.height is None:
            return []
        return [CameraHeight(height_m=self.height, sigma=self.height_sigma)]


@dataclass(frozen=True, kw_only=True)
class MetricOptions(HeightOptions):
    """Aiding measurements of length. If any of them is given, the outputs are in metres.

    Attributes
    ----------
    speed : Path or None
        CSV file of speeds, m/s, with a column ``timestamp`` and the column ``speed_column``.
    speed_column : str
        Name of the column with the speed.
    speed_sigma : float
        Relative 1-sigma of the speeds; see `KnownSpeed.sigma`.
    speed_topic : str or None
        Topic with speeds in the bag of the images: ``nav_msgs/Odometry``,
        ``geometry_msgs/TwistStamped`` or ``TwistWithCovarianceStamped``.
    distance : tuple of int, int, float or None
        Indices of two frames, and the distance in m between the camera positions at these frames.
    distance_sigma : float
        Relative 1-sigma of the distance.
    gnss : Path or None
        CSV file of positions: ``timestamp,latitude,longitude,altitude`` or ``timestamp,x,y,z``.
    gnss_sigma : float
        1-sigma of each coordinate of a position, m.
    gnss_topic : str or None
        Topic with ``sensor_msgs/NavSatFix`` in the bag of the images. If all messages have a
        covariance, the covariances replace ``gnss_sigma``.
    """

    speed: Path | None = None
    speed_column: str = "speed"
    speed_sigma: float = 0.02
    speed_topic: str | None = None
    distance: tuple[int, int, float] | None = None
    distance_sigma: float = 0.02
    gnss: Path | None = None
    gnss_sigma: float = 2.0
    gnss_topic: str | None = None

    def measurements(self, bag: Bag | None = None) -> list[AidingMeasurement]:
        """The aiding measurements, read from files and from topics of the bag of the images.

        Raises
        ------
        InputError
            If a value is invalid. The message has the expected value, and the file and the line or
            the number at fault.
        """
        found = super().measurements()
        if self.speed is not None:
            times, speeds = read_speeds(self.speed, self.speed_column)
            found.append(KnownSpeed(timestamps_s=times, speeds=speeds, sigma=self.speed_sigma))
        if self.distance is not None:
            frame0, frame1, metres = self.distance
            found.append(
                KnownDistance(
                    frame0=frame0, frame1=frame1, distance_m=metres, sigma=self.distance_sigma
                )
            )
        if self.gnss is not None:
            times, positions = read_gnss(self.gnss)
            found.append(
                GnssPositions(timestamps_s=times, positions_m=positions, sigma_m=self.gnss_sigma)
            )
        return found + self._of_topics(bag)

    def _of_topics(self, bag: Bag | None) -> list[AidingMeasurement]:
        found: list[AidingMeasurement] = []
        for option in ("speed_topic", "gnss_topic"):
            if bag is None and getattr(self, option) is not None:
                raise InputError(
                    "expected a bag as the source of the images",
                    field=f"--metric.{option.replace('_', '-')}",
                )
        if bag is not None and self.speed_topic is not None:
            found.append(speeds_of_topic(bag, self.speed_topic, self.speed_sigma))
        if bag is not None and self.gnss_topic is not None:
            found.append(positions_of_topic(bag, self.gnss_topic, self.gnss_sigma))
        return found
