"""Integrity check of image files before decoding, because decoders conceal missing data.

OpenCV does not verify the checksums of a PNG. The JPEG library of OpenCV fills missing data of a
truncated file with grey and writes a warning to standard error. For PNG and JPEG, the bytes of the
file show whether the file is complete. This check takes 0.1 of the time of decoding. Damage inside
the scan of a JPEG appears only in the messages of the decoder, which `farpoint.frames.decode`
reads.
"""

from __future__ import annotations

import zlib

__all__ = ["JPEG_START", "find_damage"]

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_START, _JPEG_SCAN, _JPEG_END = b"\xff\xd8\xff", b"\xff\xda", b"\xff\xd9"


def find_damage(data: bytes) -> str | None:
    """Description of damage in the bytes of an image file; None if no damage is found.

    Only PNG and JPEG files can be checked; files of other formats are left to the decoder.
    """
    if not data:
        return "the file is empty"
    if data.startswith(_PNG_SIGNATURE):
        return _find_png_damage(data)
    # The end marker must follow the last scan: a thumbnail has an end marker of its own.
    if data.startswith(JPEG_START) and data.rfind(_JPEG_END) < data.rfind(_JPEG_SCAN):
        return "the JPEG is truncated"
    return None


def _find_png_damage(data: bytes) -> str | None:
    """Check each chunk (length, type, content, CRC-32 of type and content) up to IEND."""
    view, start = memoryview(data), len(_PNG_SIGNATURE)
    while start + 12 <= len(data):
        length = int.from_bytes(view[start : start + 4], "big")
        end = start + 12 + length
        if end > len(data):
            break
        if zlib.crc32(view[start + 4 : end - 4]) != int.from_bytes(view[end - 4 : end], "big"):
            return f"the PNG is damaged (checksum of the chunk at byte {start})"
        if view[start + 4 : start + 8] == b"acTL":
            return "is an animated PNG; expected one image"
        if view[start + 4 : start + 8] == b"IEND":
            return None
        start = end
    return "the PNG is truncated"
