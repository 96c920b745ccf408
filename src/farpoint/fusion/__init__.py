"""Fusion of two-view motions with an IMU in a Kalman filter."""

from farpoint.fusion.filter import InertialFilter, Innovation, StartSigmas
from farpoint.fusion.imu import ImuNoise, ImuSamples, ImuSteps, read_bag_imu, read_euroc_imu
from farpoint.fusion.state import InertialState

__all__ = [
    "ImuNoise",
    "ImuSamples",
    "ImuSteps",
    "InertialFilter",
    "InertialState",
    "Innovation",
    "StartSigmas",
    "read_bag_imu",
    "read_euroc_imu",
]
