"""The camera of an image topic, from a ``CameraInfo`` message."""

from __future__ import annotations

import re
from typing import Any

from farpoint.camera import Camera
from farpoint.camera.files.camera_info import CameraInfo, camera_of_info
from farpoint.camera.files.read_out import ReadOut
from farpoint.errors import InputError
from farpoint.frames.bags.decoding import by_definition, decoder_of, kind_of
from farpoint.frames.bags.records import Bag, BrokenBagError, Topic

__all__ = ["camera_of"]

_KINDS = frozenset({"CameraInfo", "CameraCalibration"})
_TRANSPORT = re.compile(r"/(?:compressed|theora|ffmpeg|h264|h265|video|compressedDepth|zstd)$")
_RECTIFIED = re.compile(r"(?:^|_)rect(?:_|$)|rectified")
_HELP = "give a calibration by --camera"


def camera_of(bag: Bag, images: Topic, frame_id: str) -> Camera:
    """The camera of an image topic.

    The calibration is in the topic ``camera_info`` beside the images (``/cam/camera_info`` for
    ``/cam/image_raw`` or ``/cam/image_raw/compressed``), or in the only ``CameraInfo`` topic with
    the same ``frame_id`` as the images.

    Raises
    ------
    InputError
        If there is no ``CameraInfo``, if several are possible, or if the ``CameraInfo`` has no
        calibration.
    """
    known = [topic for topic in bag.topics() if kind_of(topic) in _KINDS and topic.count != 0]
    base = _TRANSPORT.sub("", images.name)
    rectified = bool(_RECTIFIED.search(base.rpartition("/")[2]))
    beside = [f"{base.rpartition('/')[0]}/camera_info", f"{base}/camera_info"]
    for topic in known:
        if topic.name in beside:
            return _camera(bag, topic, _first(bag, topic), rectified)
    found = [(topic, _first(bag, topic)) for topic in known]
    same = [(topic, message) for topic, message in found if _frame_of(message) == frame_id]
    if len(same) == 1 and frame_id:
        return _camera(bag, *same[0], rectified)
    names = ", ".join(topic.name for topic in known)
    problem = f"{images.name} has no CameraInfo in the bag"
    problem += f" (there are {names})" if names else ""
    raise InputError(f"{problem}: {_HELP}", file=bag.path, field="--camera")


def _first(bag: Bag, topic: Topic) -> Any:
    """The first message with a calibration; else the first readable message, or None."""
    decode, first = decoder_of(topic), None
    for message in bag.messages((topic.name,)):
        if message.topic is None or message.fault is not None:
            continue
        try:
            info = decode(message.data)
            with by_definition():
                if any(_field(info, "k")):
                    return info
        except BrokenBagError:
            continue
        first = first or info
    return first


def _camera(bag: Bag, topic: Topic, message: Any, rectified: bool) -> Camera:
    try:
        with by_definition():
            info = _info(message)
    except InputError as error:
        raise InputError(error.problem, file=bag.path, field=topic.name) from None
    except BrokenBagError:
        raise InputError(f"cannot be read: {_HELP}", file=bag.path, field=topic.name) from None
    return camera_of_info(info, rectified=rectified, file=bag.path, topic=topic.name)


def _info(message: Any) -> CameraInfo:
    roi = getattr(message, "roi", None)
    return CameraInfo(
        width=int(message.width),
        height=int(message.height),
        distortion_model=str(message.distortion_model),
        d=[float(value) for value in _field(message, "d")],
        k=[float(value) for value in _field(message, "k")],
        p=[float(value) for value in _field(message, "p")],
        read_out=ReadOut(
            binning=(
                int(getattr(message, "binning_x", 0)),
                int(getattr(message, "binning_y", 0)),
            ),
            roi=(0, 0, 0, 0)
            if roi is None
            else (int(roi.x_offset), int(roi.y_offset), int(roi.width), int(roi.height)),
        ),
    )


def _field(message: Any, name: str) -> Any:
    """Field of a message. The name is in upper case in ROS 1, in lower case in ROS 2."""
    return (
        getattr(message, name, None) if hasattr(message, name) else getattr(message, name.upper())
    )


def _frame_of(message: Any) -> str:
    header = getattr(message, "header", message)
    return str(getattr(header, "frame_id", ""))
