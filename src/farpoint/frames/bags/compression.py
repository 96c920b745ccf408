"""Decompression of parts of bags, limited to the size that the bag states."""

from __future__ import annotations

import bz2
import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from farpoint.errors import optional_import
from farpoint.frames.bags.records import BrokenBagError

__all__ = ["LARGEST_CHUNK_BYTES", "decompress", "unpack_file", "unpack_message"]

LARGEST_CHUNK_BYTES = 1 << 30
"""Size limit of decompressed data (convention). Recorders write chunks of 1 to 64 MB."""

_AT_ONCE_BYTES = 1 << 22


class _Decompressor(Protocol):
    def decompress(self, data: bytes | memoryview, max_length: int) -> bytes: ...


def _zstd() -> Any:
    try:
        return importlib.import_module("compression.zstd")  # from Python 3.14 on
    except ImportError:
        return optional_import("backports.zstd", extra="ros", purpose="reading a compressed bag")


def _zstd_decompressor() -> _Decompressor:
    return _zstd().ZstdDecompressor()


def _lz4_decompressor() -> _Decompressor:
    lz4 = optional_import("lz4.frame", extra="ros", purpose="reading a compressed bag")
    return lz4.LZ4FrameDecompressor()


_KINDS: dict[str, Callable[[], _Decompressor]] = {
    "zstd": _zstd_decompressor,
    "lz4": _lz4_decompressor,
    "bz2": bz2.BZ2Decompressor,
}


def decompress(data: memoryview, kind: str, size: int) -> memoryview:
    """The decompressed data: ``size`` bytes, or fewer if the data is truncated.

    Raises BrokenBagError if the data is damaged.
    """
    if kind in ("", "none"):
        return data
    if kind not in _KINDS:
        raise BrokenBagError(f"compression {kind!r} is not known")
    if size > LARGEST_CHUNK_BYTES:
        raise BrokenBagError(f"a chunk of {size} bytes; expected {LARGEST_CHUNK_BYTES} at most")
    return memoryview(_attempt(_KINDS[kind](), data, size))


def unpack_message(data: bytes | memoryview) -> bytes:
    """Decompress a single message (zstd)."""
    decompressor = _zstd_decompressor()
    raw = _attempt(decompressor, data, LARGEST_CHUNK_BYTES)
    if not getattr(decompressor, "eof", True):
        raise BrokenBagError("compressed data is cut off")
    return raw


def unpack_file(packed: Path, to: Path) -> str | None:
    """Decompress a file (zstd); returns the reason if the data ends early, otherwise None."""
    with packed.open("rb") as source, to.open("wb") as target:
        decompressor = _zstd().ZstdDecompressor()
        while not decompressor.eof:
            data = source.read(_AT_ONCE_BYTES) if decompressor.needs_input else b""
            if not data and decompressor.needs_input:
                return "compressed data is cut off"
            try:
                target.write(_attempt(decompressor, data, _AT_ONCE_BYTES))
            except BrokenBagError as error:
                return str(error)
    return None


def _attempt(decompressor: _Decompressor, data: bytes | memoryview, size: int) -> bytes:
    try:
        return decompressor.decompress(data, size)
    except Exception as error:  # each library has errors of its own
        raise BrokenBagError(f"compressed data is damaged ({error})") from error
