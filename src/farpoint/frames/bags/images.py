"""Grey values of the images in messages."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from farpoint.errors import optional_import
from farpoint.frames.decode import UnreadableImageError, check_megapixels, decode_samples

__all__ = ["COMPRESSED", "RAW", "VIDEO", "samples_of"]

RAW = frozenset({"Image", "RawImage"})
COMPRESSED = frozenset({"CompressedImage"})
VIDEO = frozenset({"CompressedVideo"})

_COLOUR = re.compile(r"(rgb|bgr|rgba|bgra)(8|16)")
_OPENCV_TYPE = re.compile(r"(8|16)UC([134])")
_BAYER = re.compile(r"bayer_(rggb|bggr|gbrg|grbg)(8|16)")
# Index of luma in the two bytes of a pixel: U Y V Y has colour first, Y U Y V has luma first.
_INTERLEAVED = {"yuv422": 1, "uyvy": 1, "yuv422_yuy2": 0, "yuyv": 0, "yuy2": 0}
_PLANAR = ("nv12", "nv21", "nv24")  # luma is a plane of its own, in front

# Weights of libpng's luma, so that a message and a PNG file give the same grey values.
_RED, _GREEN, _BLUE, _SHIFT = 9797, 19234, 3737, 15


def samples_of(message: Any, kind: str, max_megapixels: float) -> np.ndarray:
    """Grey values (H, W) of an image message, uint8, or uint16 for more than 8 bits.

    Raises
    ------
    UnreadableImageError
        If the message has no image in a known encoding.
    """
    try:
        return _samples(message, kind, max_megapixels)
    except UnreadableImageError:
        raise
    except Exception as error:  # invalid fields cause many kinds of errors
        raise UnreadableImageError(f"the image cannot be read ({error})") from error


def _samples(message: Any, kind: str, max_megapixels: float) -> np.ndarray:
    if kind in COMPRESSED:
        return decode_samples(bytes(message.data), max_megapixels)
    encoding = str(message.encoding)
    if match := _OPENCV_TYPE.fullmatch(encoding):
        encoding = {"1": "mono", "3": "bgr", "4": "bgra"}[match[2]] + match[1]
    if encoding in _INTERLEAVED:
        return np.ascontiguousarray(
            _pixels(message, "u1", 2, max_megapixels)[..., _INTERLEAVED[encoding]]
        )
    if encoding in ("mono8", *_PLANAR):
        return np.array(_pixels(message, "u1", 1, max_megapixels)[..., 0])
    if encoding == "mono16":
        return _deep(message, 1, max_megapixels)[..., 0]
    if match := _COLOUR.fullmatch(encoding):
        order, deep = match[1], match[2] == "16"
        channels = len(order)
        pixels = (
            _deep(message, channels, max_megapixels)
            if deep
            else _pixels(message, "u1", channels, max_megapixels)
        )
        return _luma(pixels, order)
    if match := _BAYER.fullmatch(encoding):
        pixels = (
            _deep(message, 1, max_megapixels)
            if match[2] == "16"
            else _pixels(message, "u1", 1, max_megapixels)
        )
        return _demosaiced(pixels[..., 0], match[1])
    raise UnreadableImageError(f"the encoding {encoding!r} is not supported")


def _pixels(message: Any, dtype: str, channels: int, max_megapixels: float) -> np.ndarray:
    """View (H, W, channels) of the samples, without the padding at the end of each line."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    check_megapixels(width, height, max_megapixels)
    kind = np.dtype(dtype)
    line = width * channels * kind.itemsize
    step = step or line
    data = np.frombuffer(message.data, np.uint8)
    if not (width and height) or step < line or len(data) < step * (height - 1) + line:
        raise UnreadableImageError(
            f"{len(data)} bytes for {width}x{height} pixels, {step} a line: the image is cut off"
        )
    if len(data) < step * height:  # the last line need not be padded
        data = np.pad(data, (0, step * height - len(data)))
    lines = data[: step * height].reshape(height, step)[:, :line]
    return np.ascontiguousarray(lines).view(kind).reshape(height, width, channels)


def _deep(message: Any, channels: int, max_megapixels: float) -> np.ndarray:
    order = ">" if getattr(message, "is_bigendian", 0) else "<"
    return _pixels(message, f"{order}u2", channels, max_megapixels).astype(np.uint16)


def _luma(pixels: np.ndarray, order: str) -> np.ndarray:
    wide = np.uint32 if pixels.dtype == np.uint8 else np.uint64
    weight = {"r": _RED, "g": _GREEN, "b": _BLUE}
    total = sum(
        pixels[..., order.index(colour)].astype(wide) * wide(weight[colour]) for colour in "rgb"
    )
    return (total >> wide(_SHIFT)).astype(pixels.dtype)


def _demosaiced(mosaic: np.ndarray, pattern: str) -> np.ndarray:
    cv2 = optional_import("cv2", extra="video", purpose="reading images")
    code = getattr(cv2, f"COLOR_Bayer{pattern.upper()}2GRAY")
    return cv2.cvtColor(np.ascontiguousarray(mosaic), code)
