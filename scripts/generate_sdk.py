"""Write `helios_client.sdk` from `helios_client.sdk_async`; `--check` exits 1 if it is stale.

The asynchronous module is the source. The generated module is the same text without `async` and
`await`, with the blocking counterparts of the names it uses.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

CLIENT = Path(__file__).resolve().parent.parent / "clients/helios_client"
SOURCE, TARGET = CLIENT / "sdk_async.py", CLIENT / "sdk.py"
REPLACED = (  # pattern, replacement; applied in this order
    (r"HTTP interface, for asyncio", "HTTP interface"),
    (r"For use in one event loop\.", "Safe to use from several threads."),
    (r"^import asyncio\n", ""),
    (r"\basyncio\.sleep\b", "time.sleep"),
    (r"\basync (def|with|for)\b", r"\1"),
    (r"\bawait ", ""),
    (r"\bAsync(Helios|Teleop|Client|BaseTransport|Iterator)\b", r"\1"),
    (r"\b__a(enter|exit)__\b", r"__\1__"),
    (r"\.a(close|read|iter_\w+)\(", r".\1("),
    (
        r"`python -m scripts.generate_sdk` writes [^`]*`helios_client.sdk`.*?file\.\n",
        "The same with `await` is `helios_client.sdk_async.AsyncHelios`. Change that file:\n"
        "`python -m scripts.generate_sdk` writes this one from it.\n",
    ),
)


def generated() -> str:
    """Text of the blocking SDK, formatted. Raises ValueError for a pattern without a match."""
    text = SOURCE.read_text()
    for pattern, instead in REPLACED:
        text, count = re.subn(pattern, instead, text, flags=re.MULTILINE | re.DOTALL)
        if not count:
            raise ValueError(f"{pattern!r} is nowhere in {SOURCE.name}; take it out of REPLACED")
    ruff = [sys.executable, "-m", "ruff"]
    for command in (["check", "--select", "I", "--fix", "--quiet"], ["format"]):
        done = subprocess.run(
            [*ruff, *command, "--stdin-filename", str(TARGET), "-"],
            input=text,
            capture_output=True,
            text=True,
            check=True,
        )
        text = done.stdout
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the blocking SDK")
    parser.add_argument("--check", action="store_true", help="change nothing; exit 1 if stale")
    text = generated()
    if not parser.parse_args().check:
        TARGET.write_text(text)
    elif text != TARGET.read_text():
        sys.exit(
            f"{TARGET.name} is not what {SOURCE.name} says; run python -m scripts.generate_sdk"
        )


if __name__ == "__main__":
    main()
