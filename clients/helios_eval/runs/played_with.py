"""What a folder's episodes were played with: versions of the libraries, files of settings, and code
of agents of other packages.

An episode's key does not hold them, so a run that continues a folder compares them.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from helios_core.errors import InvalidInput

from helios_eval.episodes.agent_code import agent_code, name_of
from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.episodes.run_conditions import setting_file_names, setting_files
from helios_eval.episodes.service_settings import of_stack
from helios_eval.ledger import FIRST_SEED
from helios_eval.provenance import UNKNOWN

# Keys of `run.json`: versions of the last run, those of all runs, and digests of files by setting.
VERSIONS, ALL_VERSIONS, FILES = "versions", "all_versions", "setting_files"
_OWN = "helios-ovmm"  # in a checkout the commit tells more than its version
_LIBRARIES = ("numpy", "mujoco", "numba", "opencv-python-headless", "scipy", "protobuf")


def versions_here() -> dict[str, str]:
    """Version of Python, of this program and of the libraries that results depend on, by name."""
    return {
        "python": platform.python_version(),
        **{name: version(name) for name in (_OWN, *_LIBRARIES)},
    }


def versions_of(run: Mapping[str, Any]) -> list[dict[str, str]]:
    """Versions that the episodes of a `run.json` were played with, each once, oldest first."""
    found = run.get(ALL_VERSIONS) or [run[k] for k in (VERSIONS,) if isinstance(run.get(k), dict)]
    return [v for k, v in enumerate(found) if v not in found[:k]]


def other_versions(run: Mapping[str, Any], commit: str) -> str:
    """Versions of `run.json` that differ from those here, as "numpy 1.0 (here 2.0)"; empty if none.

    commit: the present one. In a checkout the version of this program does not count.
    """
    here = versions_here()
    if commit != UNKNOWN:
        del here[_OWN]
    differing = [
        f"{name} {was[name]} (here {now})"
        for was in versions_of(run)
        for name, now in here.items()
        if was.get(name, now) != now
    ]
    return ", ".join(dict.fromkeys(differing))


def line_on_versions(
    there: Sequence[EpisodeRecord], run: Mapping[str, Any], commit: str, out: Path, is_unseen: bool
) -> str:
    """Line for the terminal if the folder's episodes were played with other versions; else empty.

    there, run: episodes and `run.json` of the folder. commit: the present one. Raises InvalidInput
    if homes from seed 1000 on would be played with both (is_unseen: this run plays such homes).
    """
    played = [r for r in there if r.was_played]
    said = other_versions(run, commit) if played else ""
    if said and is_unseen and any(r.seed >= FIRST_SEED for r in played):
        raise InvalidInput(
            f"{out} holds episodes of homes from seed {FIRST_SEED} on, played with {said}; "
            "install those versions to go on, or take another folder"
        )
    return said and (
        f"Earlier episodes of {out} were played with {said}; results may differ by that alone."
    )


def files_of(agents: Sequence[str], settings: Mapping[str, Any]) -> dict[str, str]:
    """Digests of the files that a request's settings name, and of the code of its agents of other
    packages, by name. Raises UsageError, and InvalidInput for an agent that cannot be loaded."""
    return setting_files(agents, settings) | agent_code(agents)


def changed_file(
    record: EpisodeRecord, now: Mapping[str, str], run: Mapping[str, Any]
) -> tuple[str, str, str] | None:
    """(what, digest there, digest here) if a file that the record's settings name, or the code of
    its agent, has changed.

    now: of `files_of`. run: `run.json` of the record's folder; a file that it lacks counts as
    unchanged.
    """
    before = run.get(FILES, {})
    names = setting_file_names(of_stack(record.agent, record.settings))
    for name in (*names, name_of(record.agent)):
        was, here = before.get(name), now.get(name)
        if was and here and was != here:
            return f"file of {name}", was, here
    return None


def described(
    agents: Sequence[str], settings: Mapping[str, Any], former: Mapping[str, Any]
) -> dict[str, Any]:
    """Digests of `files_of` and of those in the former `run.json`, as an entry of `run.json`; empty
    without a file. Raises as `files_of`."""
    files = former.get(FILES, {}) | files_of(agents, settings)
    return {FILES: files} if files else {}
