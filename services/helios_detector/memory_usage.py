"""How much memory there is and how much is used. Linux tells; elsewhere what is known."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

MB = 1e6
FLOATS = ("F64", "F32", "F16", "BF16")
MOST_HEADER_BYTES = 100_000_000  # the format's own limit


def free_mb(device: str) -> float | None:
    """Memory that a model may still take on a device; None where the system does not tell."""
    if device.startswith("cuda"):
        import torch

        return torch.cuda.mem_get_info(torch.device(device))[0] / MB
    return _proc_mb("/proc/meminfo", "MemAvailable:")


def resident_mb() -> float:
    """Memory of this process now (Linux), else its highest so far."""
    now = _proc_mb("/proc/self/status", "VmRSS:")
    if now is not None:
        return now
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / MB if sys.platform == "darwin" else peak * 1024 / MB


def accelerator_mb(device: str) -> float | None:
    """The most that tensors took on the device since the last call; None on a processor."""
    if not device.startswith("cuda"):
        return None
    import torch

    peak = torch.cuda.max_memory_allocated(torch.device(device)) / MB
    torch.cuda.reset_peak_memory_stats(torch.device(device))
    return peak


def weights_mb(source: str, number_bytes: int = 4) -> float:
    """Memory for the weights of a folder or of a cached model id; 0 when they are not there.

    `number_bytes` is of a number once it is loaded: files hold float32 or half precision, whatever
    is asked for.
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
    return sum(f.stat().st_size for f in folder.glob("*.bin")) / MB


def _loaded_bytes(file: Path, number_bytes: int) -> int:
    """Of a safetensors file: a header in JSON says the type and shape of each of its arrays."""
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
    except (ValueError, KeyError, TypeError, AttributeError):
        return file.stat().st_size  # damaged: loading it says so


def _proc_mb(path: str, key: str) -> float | None:
    try:
        text = Path(path).read_text()
    except OSError:
        return None
    for line in text.splitlines():
        if line.startswith(key):
            return int(line.split()[1]) * 1024 / MB
    return None
