"""Write the newest versions that pyproject.toml and the chosen versions allow into constraints.txt.

Run it as `make lock`. It makes a temporary environment, which takes some minutes.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FILE = ROOT / "constraints.txt"
MARK = "# All others, by `make lock`:\n"


def pins(frozen: str, chosen: str) -> list[str]:
    """Pins of `pip freeze`, without those that are chosen already, pip itself, editable installs,
    and the local part of a version (such as +cpu)."""
    names = {line.partition("==")[0].lower() for line in chosen.splitlines() if "==" in line}
    names.add("pip")
    lines = (line.partition("+")[0] for line in frozen.splitlines() if "==" in line)
    return sorted(
        (line for line in lines if line.partition("==")[0].lower() not in names), key=str.lower
    )


def main() -> None:
    chosen = FILE.read_text().partition(MARK)[0]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        venv.create(folder / "venv", with_pip=True)
        (folder / "chosen.txt").write_text(chosen)
        pip = [str(folder / "venv/bin/python"), "-m", "pip", "--disable-pip-version-check"]
        install = ["install", "--quiet", "--constraint", str(folder / "chosen.txt")]
        subprocess.run([*pip, *install, "--editable", f"{ROOT}[all,dev]"], check=True)
        frozen = subprocess.run(
            [*pip, "freeze", "--all", "--exclude-editable"],
            check=True,
            capture_output=True,
            text=True,
        ).stdout
    found = pins(frozen, chosen)
    FILE.write_text("\n".join([chosen + MARK.rstrip(), *found]) + "\n")
    print(f"{len(found)} versions in {FILE}", file=sys.stderr)


if __name__ == "__main__":
    main()
