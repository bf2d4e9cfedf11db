"""A real detector in the loop of an evaluation: which model it is, checked before a run.

Records name the model by its file name and the first 16 hex digits of its SHA-256, so that a run
cannot continue with another file of the same name, and can with a copy in another folder.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from helios_client.usage_errors import UsageError
from helios_core.errors import InvalidInput, Unavailable
from helios_core.models.model_folder import onnx_file

DIGITS = 16  # hex digits of a digest in a record
_SIMULATED = ("simulated", "ground-truth", "recorded")


@dataclass(frozen=True)
class RealDetector:
    """Model that an episode's detections come from."""

    spec: str  # as `model_loading.open_detector` takes it, with the path on this machine
    name: str  # as records name it: onnx:FILE@DIGEST
    sha256: str  # of the file or folder; empty for a model of the hub or of a package

    def check(self) -> None:
        """Raises Unavailable if the file is not the one that the run began with."""
        if self.sha256 and digest_of(_path(self.spec)) != self.sha256:
            raise Unavailable(
                f"{_path(self.spec)} has changed since the run began (its SHA-256 was "
                f"{self.sha256[:DIGITS]}); put that file back, or start another run"
            )


def real_detector(spec: str) -> RealDetector:
    """The model that `--detector` names, a fetched ONNX file also by its bare name.

    Raises UsageError for a simulated or missing one.
    """
    kind, _, argument = spec.partition(":")
    if kind in _SIMULATED:
        raise UsageError(
            f"--detector is {spec!r}, which is no real detector; wanted onnx:FILE or "
            "transformers:ID, or --semantics noisy or ground-truth without --detector"
        )
    if kind == "onnx":
        spec = f"onnx:{onnx_file(argument)}"
    path = _path(spec)
    if kind == "onnx" and not path.is_file():
        raise UsageError(
            f"--detector is {spec!r}, and {path} is no file; give onnx:FILE, or fetch a model with "
            "`helios models fetch`"
        )
    if kind not in ("onnx", "transformers") or not argument:
        _check_opens(spec)
    if argument and path.exists():
        sha256 = digest_of(path)
        return RealDetector(spec, f"{kind}:{path.name}@{sha256[:DIGITS]}", sha256)
    return RealDetector(spec, spec, "")


def digest_of(path: Path) -> str:
    """SHA-256 (hex) of a file with the class names beside it, or of all files of a folder.

    Without such names it is that of the file alone.
    """
    beside = path.with_suffix(".txt")
    if path.is_file() and not beside.is_file():
        return _digest_of_file(path)
    files = [path, beside] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    digest = hashlib.sha256()
    for file in files:
        digest.update(f"{file.relative_to(path.parent)}\n".encode())
        digest.update(bytes.fromhex(_digest_of_file(file)))
    return digest.hexdigest()


def _digest_of_file(path: Path) -> str:
    """SHA-256 (hex) of a file. It is read again only if its size or time has changed: a large model
    is checked before each episode."""
    now = path.stat()
    return _digest_as_of(path, now.st_mtime_ns, now.st_size)


@lru_cache(maxsize=256)
def _digest_as_of(path: Path, _mtime_ns: int, _size: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def equal_but_for_digest(name: str, other: str) -> bool:
    """True if two names of a record (NAME@DIGEST) have the same part before the digest."""
    return name.partition("@")[0] == other.partition("@")[0]


def _path(spec: str) -> Path:
    return Path(spec.partition(":")[2])


def _check_opens(spec: str) -> None:
    from helios_detector.backend import DetectorOptions
    from helios_detector.model_loading import open_detector

    try:
        open_detector(spec, DetectorOptions()).close()
    except (InvalidInput, Unavailable) as error:
        raise UsageError(f"--detector: {error.message}") from error
