"""Reading of external ZIP and NPZ files, with a check of their size before unpacking."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from helios_core.errors import InvalidInput

# Enough for 64 million cells with two value layers, or a million Gaussians with 32 classes.
MOST_BYTES = 2 * 2**30
# With these two methods zipfile reads no more than a member's size; with others, whole blocks.
PACKED_AS = {zipfile.ZIP_STORED: "stored", zipfile.ZIP_DEFLATED: "deflated"}


def check_packing(members: Iterable[zipfile.ZipInfo], remedy: str) -> None:
    """Check that the sizes that a ZIP declares limit what its members unpack to.

    remedy: end of the message of the InvalidInput that it raises for any other compression.
    """
    for member in members:
        if member.compress_type not in PACKED_AS:
            raise InvalidInput(
                f"{member.filename[:80]!r} of the file is compressed by ZIP method "
                f"{member.compress_type}; wanted {' or '.join(PACKED_AS.values())}: {remedy}"
            )


_REPACK = "write it anew with numpy.savez, or save the map again"


def unpacked(data: bytes, most_bytes: int = MOST_BYTES) -> dict[str, NDArray]:
    """Arrays of an NPZ by name.

    Raises InvalidInput without unpacking if the content exceeds both `most_bytes` and the size of
    the file, or if the compression is not one of numpy's. A damaged file, or one that is no NPZ,
    raises the exceptions of zipfile and numpy.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        members = file.infolist()
    holds = sum(member.file_size for member in members)
    most_bytes = max(most_bytes, len(data))
    if holds > most_bytes:
        raise InvalidInput(
            f"the file has {len(data)} bytes and unpacks to {holds}, wanted at most {most_bytes}: "
            "give a file that HELIOS saved, or a smaller map"
        )
    check_packing(members, _REPACK)
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def one_array(data: bytes, name: str, most_bytes: int) -> NDArray:
    """One array of an NPZ; the others are not unpacked.

    Raises InvalidInput if it unpacks to more than `most_bytes`, or if the compression is not one of
    numpy's. A damaged file, or one without it, raises the exceptions of zipfile and numpy.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        member = file.getinfo(f"{name}.npy")
        if member.file_size > most_bytes:
            raise InvalidInput(
                f"array {name} of the file unpacks to {member.file_size} bytes, wanted at most "
                f"{most_bytes}: give a file that HELIOS saved"
            )
        check_packing([member], _REPACK)
        return np.lib.format.read_array(io.BytesIO(file.read(member)), allow_pickle=False)
