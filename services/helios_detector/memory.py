"""How much memory there is and how much is used. Linux tells; elsewhere what is known."""

from __future__ import annotations

import sys
from pathlib import Path

MB = 1e6


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


def weights_mb(source: str) -> float:
    """Size of the weight files of a folder or of a cached model id; 0 when they are not there."""
    folder = Path(source)
    if not folder.is_dir():
        from huggingface_hub import try_to_load_from_cache

        config = try_to_load_from_cache(source, "config.json")
        if not isinstance(config, str):
            return 0.0
        folder = Path(config).parent
    files = list(folder.glob("*.safetensors")) or list(folder.glob("*.bin"))
    return sum(f.stat().st_size for f in files) / MB


def _proc_mb(path: str, key: str) -> float | None:
    try:
        text = Path(path).read_text()
    except OSError:
        return None
    for line in text.splitlines():
        if line.startswith(key):
            return int(line.split()[1]) * 1024 / MB
    return None
