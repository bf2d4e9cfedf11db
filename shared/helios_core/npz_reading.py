"""NPZ files that come from outside: how much one holds is asked before any of it is unpacked."""

from __future__ import annotations

import io
import zipfile

import numpy as np
from numpy.typing import NDArray

from helios_core.errors import InvalidInput

# 64 million cells of a 2D map with two value layers, or a million Gaussians with 32 classes.
MOST_BYTES = 2 * 2**30


def unpacked(data: bytes, most_bytes: int = MOST_BYTES) -> dict[str, NDArray]:
    """The arrays of an NPZ by name.

    Raises InvalidInput, and unpacks nothing, for one that holds more than `most_bytes` and more
    than the file has itself, or that is packed otherwise than by numpy. A file that is damaged or
    no NPZ raises what the readers of ZIP and of arrays think of it.
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
    # Of these two no more is read than a member's size says; of others a whole block is.
    if any(m.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for m in members):
        raise InvalidInput(
            "the file is packed otherwise than numpy packs: write it anew with numpy.savez, or "
            "save the map again"
        )
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        return {name: file[name] for name in file.files}
