"""Check that a bill of materials names the locked versions: `python -m scripts.check_sbom FILE`.

It prints every package of the CycloneDX file that `constraints.txt` lacks or locks in another
version, and then ends with status 1.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name

CONSTRAINTS = Path(__file__).parents[1] / "constraints.txt"
OWN = {"helios-ovmm", "pip", "setuptools"}  # not locked: ours, and those of a new environment


def differences(bill: Mapping[str, Any], constraints: str) -> list[str]:
    """One sentence per package of the bill that is not locked in its version."""
    locked = {
        canonicalize_name(name): version
        for name, _, version in (line.partition("==") for line in constraints.splitlines())
        if version
    }
    out = []
    for component in bill["components"]:
        name, version = canonicalize_name(component["name"]), component["version"].partition("+")[0]
        if name not in OWN and locked.get(name) != version:
            out.append(
                f"{name} {version}: constraints.txt has {locked.get(name, 'no such package')}"
            )
    return out


def main() -> int:
    found = differences(json.loads(Path(sys.argv[1]).read_text()), CONSTRAINTS.read_text())
    for sentence in found:
        print(sentence, file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
