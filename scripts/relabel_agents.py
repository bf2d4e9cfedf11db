"""Rename the agents in results from before release 0.2.0 to their present names.

    python scripts/relabel_agents.py docs/results/noisy docs/results/ideas

Nothing else changes. `helios` was the method of the paper and is `helios-paper` now; `helios-next`
is `helios` now. Takes folders as `helios eval report RUN --out FOLDER` writes them:
`episodes.jsonl.gz`, `run.json`, `results.json`. Notes the change in `run.json` under `relabelled`.
Refuses a folder that has this note or a present name. Make the report anew afterwards:
`helios eval report FOLDER`.
"""

from __future__ import annotations

import argparse
import gzip
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from helios_core.atomic_file import write_file
from helios_eval.episodes.episode_record import EPISODES, PACKED
from helios_eval.report.run_description import RUN
from helios_eval.runs.results import RESULTS

NAMES = {"helios": "helios-paper", "helios-next": "helios"}
NOTE = "relabelled"
_FLAGS = ("--agent", "--agents")


def relabelled(name: str) -> str:
    """Present name of an agent."""
    return NAMES.get(name, name)


def relabelled_command(words: Sequence[str]) -> list[str]:
    """Command line with the present names after `--agent` and `--agents`."""
    out: list[str] = []
    for before, word in zip(("", *words), words, strict=False):
        flag, equals, value = word.partition("=")
        if before in _FLAGS:
            out.append(_list(word))
        elif flag in _FLAGS and equals:
            out.append(f"{flag}={_list(value)}")
        else:
            out.append(word)
    return out


def relabelled_run(run: dict[str, Any]) -> dict[str, Any]:
    """`run.json` with the present names in its commands, `agents`, `asked` and `ran_with`."""
    out = dict(run)
    if "command" in run and not isinstance(run["command"], str):
        out["command"] = relabelled_command(run["command"])
    if "commands" in run:
        out["commands"] = [relabelled_command(c) for c in run["commands"]]
    if "agents" in run:
        out["agents"] = [relabelled(a) for a in run["agents"]]
    if "asked" in run:
        out["asked"] = [o | {"agents": [relabelled(a) for a in o["agents"]]} for o in run["asked"]]
    if "ran_with" in run:
        out["ran_with"] = {relabelled(a): told for a, told in run["ran_with"].items()}
    return out | {NOTE: NAMES}


def relabel(folder: Path) -> dict[str, bytes]:
    """New contents of a folder's files, by file name. Raises ValueError if the folder is not a
    packed run, is relabelled already, or has present names."""
    if (folder / EPISODES).exists():
        raise ValueError(f"{folder} holds {EPISODES}; pack it: helios eval report {folder} --out …")
    run = json.loads((folder / RUN).read_text(encoding="utf-8"))
    if NOTE in run:
        raise ValueError(f"{folder} is relabelled already: its {RUN} says so")
    records = [
        json.loads(line)
        for line in gzip.decompress((folder / PACKED).read_bytes()).split(b"\n")
        if line
    ]
    rows = json.loads((folder / RESULTS).read_text(encoding="utf-8"))
    if any(r["agent"] == NAMES["helios"] for r in (*records, *rows)):
        raise ValueError(f"{folder} has episodes of {NAMES['helios']}, which is a present name")
    lines = "".join(_line(r | {"agent": relabelled(r["agent"])}) for r in records)
    told = [row | {"agent": relabelled(row["agent"])} for row in rows]
    return {
        RUN: (json.dumps(relabelled_run(run), indent=1) + "\n").encode(),
        PACKED: gzip.compress(lines.encode(), 9, mtime=0),
        RESULTS: (json.dumps(told, indent=1) + "\n").encode(),
    }


def _list(names: str) -> str:
    return ",".join(relabelled(name) for name in names.split(","))


def _line(record: dict[str, Any]) -> str:
    return json.dumps(record, separators=(",", ":"), ensure_ascii=False) + "\n"


def main(argv: Sequence[str] | None = None) -> int:
    """Relabel all folders, or none; exit status 2 if one is refused."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    folders: list[Path] = parser.parse_args(argv).folders
    try:
        new = {folder: relabel(folder) for folder in dict.fromkeys(folders)}
    except (OSError, ValueError, KeyError, TypeError) as error:
        print(f"relabel_agents: nothing is changed: {error}", file=sys.stderr)
        return 2
    for folder, files in new.items():
        for name, contents in files.items():
            write_file(folder / name, contents)
    return 0


if __name__ == "__main__":
    sys.exit(main())
