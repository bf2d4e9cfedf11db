"""Tests that each package needs only the core and its own extra.

Instead of one virtual environment per extra, a process refuses every module of a distribution that
the extra does not install, and then imports the whole package.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from importlib import metadata

import pytest

PACKAGES = {
    "detector": "helios_detector",
    "objectmap": "helios_objectmap",
    "map2d": "helios_map2d",
    "planner": "helios_planner",
    "bridge": "helios_bridge",
    "gateway": "helios_gateway",
    "recorder": "helios_recorder",
    "client": "helios_client",
    "sim": "helios_sim",
    "spot": "helios_spot",
    "contract": "helios_contract",
    "mcp": "helios_client",
    "certs": "helios_client",
}
# Modules that need more than the extra: the extras `mcp` and `certs`.
OF_MCP, OF_CERTS = "helios_client.mcp_tools", "helios_client.certs"
NEEDS_MORE = {"client": [OF_MCP, OF_CERTS], "mcp": [OF_CERTS], "certs": [OF_MCP]}
OURS = "helios-ovmm"
IMPORT_ALL = """
import importlib, json, pkgutil, sys
allowed, package = set(json.loads(sys.argv[1])), sys.argv[2]
class Refuse:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top in FOREIGN:
            raise ModuleNotFoundError(f"{name} is not among what the extra brings", name=top)
from importlib import metadata
FOREIGN = {m for m, ds in metadata.packages_distributions().items()
           if not any(d.lower().replace("_", "-") in allowed for d in ds)}
for name in list(sys.modules):
    if name.partition(".")[0] in FOREIGN:
        del sys.modules[name]
sys.meta_path.insert(0, Refuse())
found = importlib.import_module(package)
more = tuple(json.loads(sys.argv[3]))
for info in pkgutil.walk_packages(found.__path__, package + "."):
    if not info.name.endswith("__main__") and not info.name.startswith(more):
        importlib.import_module(info.name)
"""


def closure(extra: str) -> set[str]:
    """Names of all distributions that the core and one extra install."""
    todo, seen = [(OURS, frozenset({extra}))], set()
    while todo:
        name, extras = todo.pop()
        name = name.lower().replace("_", "-")
        if (name, extras) in seen:
            continue
        seen.add((name, extras))
        try:
            wanted = metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            continue  # for another system or Python
        for requirement in wanted:
            text, _, marker = requirement.partition(";")
            asked = re.search(r"extra\s*==\s*['\"]([^'\"]+)['\"]", marker)
            if asked and asked.group(1) not in extras:
                continue
            parts = re.match(r"\s*([A-Za-z0-9._-]+)\s*(?:\[([^\]]*)\])?", text)
            assert parts
            more = frozenset(e.strip() for e in (parts.group(2) or "").split(",") if e.strip())
            todo.append((parts.group(1), more))
    return {name for name, _ in seen}


@pytest.mark.parametrize("extra", PACKAGES)
def test_a_package_needs_only_its_own_extra(extra: str) -> None:
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            IMPORT_ALL,
            json.dumps(sorted(closure(extra))),
            PACKAGES[extra],
            json.dumps(NEEDS_MORE.get(extra, [])),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-1500:]
