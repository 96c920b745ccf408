"""NumPy archives (``.npz``) of calibration scripts: small arrays, read without unpickling."""

from __future__ import annotations

import io
import zipfile
import zlib
from typing import Any

import numpy as np

__all__ = ["MAGIC", "arrays_of_npz"]

MAGIC = b"PK\x03\x04"
# A camera matrix, its coefficients and an image size are far smaller.
LARGEST_MEMBER_BYTES = 1 << 16
MOST_MEMBERS = 1000
PICKLED = "<pickled-objects>"


def arrays_of_npz(data: bytes) -> dict[str, Any]:
    """Arrays of an archive as nested lists. Arrays too large for a calibration are left out.

    An array of Python objects becomes the word `PICKLED`. Reading numbers from this array fails
    with an error that contains the word.

    Raises
    ------
    ValueError
        If the archive or one of its arrays is damaged.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()
            if len(members) > MOST_MEMBERS:
                raise ValueError(f"expected at most {MOST_MEMBERS} arrays, got {len(members)}")
            return {
                member.filename.removesuffix(".npy"): _array(archive, member)
                for member in members
                if member.filename.endswith(".npy") and member.file_size <= LARGEST_MEMBER_BYTES
            }
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise ValueError(str(error) or type(error).__name__) from None


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Any:
    with archive.open(member) as stream:
        content = io.BytesIO(stream.read(LARGEST_MEMBER_BYTES))
    version = np.lib.format.read_magic(content)
    header = (
        np.lib.format.read_array_header_1_0
        if version == (1, 0)
        else np.lib.format.read_array_header_2_0
    )
    shape, _, dtype = header(content)
    if dtype.hasobject:
        return [PICKLED]
    # The size in the header is checked before memory is allocated.
    if dtype.itemsize * np.prod(shape, dtype=float) > LARGEST_MEMBER_BYTES:
        raise ValueError(f"{member.filename} promises {shape} numbers and is shorter")
    content.seek(0)
    return np.lib.format.read_array(content, allow_pickle=False).tolist()
