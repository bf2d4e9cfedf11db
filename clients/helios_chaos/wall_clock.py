"""Wall clock of the services under test, which can jump. The system's own clock stays as it is.

A small library (`wall_clock.c`), preloaded into each process, adds an offset to the wall clock. All
processes share it, as on one machine. Monotonic clocks, sleeps and the times of files stay true.
libfaketime was tried first: version 0.9.10 makes `time.sleep` fail on Linux.
"""

from __future__ import annotations

import shutil
import struct
import subprocess
from pathlib import Path

SOURCE = Path(__file__).with_name("wall_clock.c")
OFFSET = struct.Struct("=q")  # nanoseconds


class WallClock:
    """Offset of the wall clock, in a file of `folder`."""

    def __init__(self, folder: Path) -> None:
        """Compile the library. Raises OSError or CalledProcessError without a C compiler."""
        folder.mkdir(parents=True, exist_ok=True)
        self._file, library = folder / "clock-offset", folder / "wall_clock.so"
        self._file.write_bytes(OFFSET.pack(0))
        compiler = shutil.which("cc") or "cc"
        argv = [compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(SOURCE)]
        subprocess.run(argv, check=True, capture_output=True, text=True)
        self.environment = {"LD_PRELOAD": str(library), "HELIOS_CHAOS_CLOCK": str(self._file)}

    def jump_to(self, offset_s: float) -> None:
        """Set the offset from the true time."""
        with self._file.open("r+b") as file:  # the same file: the processes have mapped it
            file.write(OFFSET.pack(round(offset_s * 1e9)))


def missing() -> str:
    """Why the wall clock cannot jump here; empty if it can."""
    if not Path("/proc/self").exists():
        return "the preloaded clock is written for Linux"
    return "" if shutil.which("cc") else "there is no C compiler for the preloaded clock"
