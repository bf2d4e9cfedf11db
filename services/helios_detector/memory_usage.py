"""Free and used memory of the host and the accelerator. Complete on Linux, partial elsewhere."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

MB = 1e6
FLOATS = ("F64", "F32", "F16", "BF16")
MOST_HEADER_BYTES = 100_000_000  # the format's own limit


def free_mb(device: str) -> float | None:
    """Free memory (MB) of a device for models; None if the system does not report it."""
    if device.startswith("cuda"):
        import torch

        return torch.cuda.mem_get_info(torch.device(device))[0] / MB
    return _proc_mb("/proc/meminfo", "MemAvailable:")


def resident_mb() -> float:
    """Resident memory (MB) of this process now (Linux), else its peak so far."""
    now = _proc_mb("/proc/self/status", "VmRSS:")
    if now is not None:
        return now
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / MB if sys.platform == "darwin" else peak * 1024 / MB


def accelerator_mb(device: str) -> float | None:
    """Peak tensor memory (MB) on a CUDA device since the last call; None on other devices."""
    if not device.startswith("cuda"):
        return None
    import torch

    peak = torch.cuda.max_memory_allocated(torch.device(device)) / MB
    torch.cuda.reset_peak_memory_stats(torch.device(device))
    return peak


def weights_mb(source: str, number_bytes: int = 4) -> float:
    """Memory (MB) for the weights of a folder or of a cached model id; 0 if they are missing or
    cannot be read, as loading them raises the error.

    `number_bytes` is the size of one weight once loaded; files may store another precision.
    """
    folder = Path(source)
    if not folder.is_dir():
        from huggingface_hub import try_to_load_from_cache

        config = try_to_load_from_cache(source, "config.json")
        if not isinstance(config, str):
            return 0.0
        folder = Path(config).parent
    files = list(folder.glob("*.safetensors"))
    if files:
        return sum(_loaded_bytes(f, number_bytes) for f in files) / MB
    return sum(map(_file_bytes, folder.glob("*.bin"))) / MB


def _loaded_bytes(file: Path, number_bytes: int) -> int:
    """Loaded size of a safetensors file, from the array types and shapes in its JSON header."""
    try:
        with file.open("rb") as opened:
            size = int.from_bytes(opened.read(8), "little")
            header = json.loads(opened.read(min(size, MOST_HEADER_BYTES)))
        arrays = [a for name, a in header.items() if name != "__metadata__"]
        return sum(
            math.prod(a["shape"]) * number_bytes
            if a["dtype"] in FLOATS
            else a["data_offsets"][1] - a["data_offsets"][0]
            for a in arrays
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return _file_bytes(file)  # damaged file: loading it raises the error


def _file_bytes(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0


def _proc_mb(path: str, key: str) -> float | None:
    try:
        text = Path(path).read_text()
    except OSError:
        return None
    for line in text.splitlines():
        if line.startswith(key):
            return int(line.split()[1]) * 1024 / MB
    return None
