"""How often the homes of a run had been played before it, by the ledger.

A line of the ledger belongs to the run itself if it names a folder of the run and one of its
requests, and if the run's episodes are of the line's code. If they are of other code, the line's
own episodes were deleted, and it is an earlier run. A line that was entered afterwards belongs to a
run with episodes of the same commit. Earlier lines with its own reason and commit are told apart:
they are parts of one release.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from helios_core.errors import HeliosError

from helios_eval import ledger
from helios_eval.episodes.episode_record import EpisodeRecord
from helios_eval.episodes.episode_spec import EpisodeSpec
from helios_eval.ledger import AFTERWARDS, FIRST_SEED, Entry
from helios_eval.provenance import DIRTY, same_code
from helios_eval.report.number_format import plural, ranges
from helios_eval.report.requested_episodes import commands_of, requests_of

FACT = "played before"
IN_STEPS = "homes added after figures"  # name of the fact on homes that were asked for in steps
SHOWN = "shown"  # key of `run.json`: arm -> numbers of homes that its figures were over, in order
NEVER = "never by the ledger"
NO_LINE = "unknown: the ledger has no line of this run"
NO_LEDGER = "unknown: an installation outside a checkout has no ledger"
MOST_FOLDERS = 6  # folders that a sentence names
SHORT_COMMIT = 7  # digits that tell commits apart; a mark of uncommitted changes follows them

Home = tuple[str, int]  # preset and seed


@dataclass(frozen=True)
class Folder:
    """A folder that a run was played into."""

    out: str
    since: str | None  # first start, ISO 8601, UTC, to the second; None: not recorded


@dataclass(frozen=True)
class Before:
    """Other runs of the same homes: `homes` of the `total` homes from seed 1000 on."""

    entries: tuple[Entry, ...]
    seeds: tuple[int, ...]
    total: int
    release: str = ""  # reason and commit that all entries share with this run; empty: they do not

    @property
    def folders(self) -> list[str]:
        """Folders of the other runs, each once, oldest first; each stands for one run."""
        return list(dict.fromkeys(e.out for e in self.entries))

    @property
    def first(self) -> str:
        """Day of the first of them, as in 2026-11-21."""
        return self.entries[0].at[:10]


def folders_of(run: Mapping[str, Any]) -> list[Folder]:
    """Folders that a run was played into, oldest first, from its `run.json`.

    A file without `folders` gives its `out` and those of its commands, without a time.
    """
    if "folders" in run:
        return [Folder(str(f["out"]), f.get("since")) for f in run["folders"]]
    named = [*map(_out_of, commands_of(run)), run.get("out")]
    return [Folder(out, None) for out in dict.fromkeys(str(Path(n)) for n in named if n)]


def fact(records: Sequence[EpisodeRecord], run: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Facts of the report with their names; none for a run without a home from seed 1000 on."""
    if not _kept((r.preset, r.seed) for r in records):
        return []
    steps = [(IN_STEPS, text) for text in [_steps(run)] if text]
    return [(FACT, _said_before(records, run)), *steps]


def _steps(run: Mapping[str, Any]) -> str:
    """Numbers of homes after which figures were shown and more homes were asked for; empty if none
    were added."""
    grown = [", then ".join(map(str, n)) for n in run.get(SHOWN, {}).values() if len(n) > 1]
    return f"figures were over {'; '.join(dict.fromkeys(grown))} homes" if grown else ""


def _said_before(records: Sequence[EpisodeRecord], run: Mapping[str, Any]) -> str:
    try:
        if ledger.ledger_path() is None:
            return NO_LEDGER
        before = _before_run(records, run)
    except HeliosError as error:
        return f"unknown: {error}"
    if before is None:
        return NO_LINE if lacks_line(records, run) else NEVER
    named = before.folders[:MOST_FOLDERS]
    more = len(before.folders) - len(named)
    text = (
        f"by {plural(len(before.folders), 'run')}, first {before.first}, folders "
        f"{', '.join(named)}{f' and {more} more' if more else ''}"
    )
    if len(before.seeds) < before.total:
        text += f" (seeds {ranges(list(before.seeds))})"
    return text


def sentence(records: Sequence[EpisodeRecord], run: Mapping[str, Any]) -> str:
    """How many runs had played these homes before, as one sentence; empty without homes from seed
    1000 on. Raises InvalidInput and Unavailable for a ledger that cannot be read."""
    if not _kept((r.preset, r.seed) for r in records):
        return ""
    before = _before_run(records, run)
    if before is None and lacks_line(records, run):
        return "Whether these homes had been played before is unknown: the ledger lacks this run."
    if before is None:
        return "By the ledger nobody had played these homes before."
    runs = plural(len(before.folders), "earlier run")
    return f"The ledger has {runs} of these homes{', of the same release' * bool(before.release)}."


def notice(records: Sequence[EpisodeRecord], run: Mapping[str, Any]) -> str:
    """Notice for the top of the report; empty if the ledger names no earlier run, and if no homes
    were added after figures had been shown."""
    told = _steps(run)
    added = f"Homes were added after figures had been shown: {told}." if told else ""
    return " ".join(part for part in (_notice_before(records, run), added) if part)


def _notice_before(records: Sequence[EpisodeRecord], run: Mapping[str, Any]) -> str:
    try:
        before = _before_run(records, run)
        unlisted = before is None and lacks_line(records, run)
    except HeliosError:
        return ""
    if unlisted:
        return (
            f"The ledger ({ledger.LEDGER}) has no line of this run, so nothing shows that its "
            "homes are unseen."
        )
    if before is None:
        return ""
    said = f"{_share(before)} had been played before this run, by "
    said += plural(len(before.folders), "run")
    if before.release:
        return f"{said} of the same release ({before.release}): {', '.join(before.folders)}."
    return f"{said}. So these figures are not those of unseen homes."


def lacks_line(records: Sequence[EpisodeRecord], run: Mapping[str, Any]) -> bool:
    """True if the ledger has no line of this run for some home from seed 1000 on.

    Raises InvalidInput and Unavailable for a ledger that cannot be read.
    """
    own = [e for e in _entries() if _is_own(e, records, run) or _is_of_a_commit(e, records)]
    return any(
        not any(_names(e, home) for e in own) for home in _kept((r.preset, r.seed) for r in records)
    )


def line_before_a_run(specs: Sequence[EpisodeSpec], run: Mapping[str, Any]) -> str:
    """Line for the terminal if other runs have played some of these homes; else empty.

    `run` is the content of the folder's `run.json`, with the request that is about to be played and
    the present commit.
    """
    homes = _kept((s.preset, s.seed) for s in specs)
    if not homes:
        return ""
    try:
        entries = _entries()
    except HeliosError as error:
        return f"Whether these homes have been played before is unknown: {error}"
    before = _before([e for e in entries if not _is_own(e, (), run)], homes)
    if before is None:
        return ""
    if release := _shared_release(before, run):
        return (
            f"{_share(before)} (seeds {ranges(list(before.seeds))}) have been played before, by "
            f"{plural(len(before.folders), 'run')} of the same release ({release})."
        )
    return (
        f"{_share(before)} (seeds {ranges(list(before.seeds))}) have been played before, by "
        f"{plural(len(before.folders), 'run')} since {before.first} ({ledger.LEDGER}): the figure "
        "is no longer one of unseen homes."
    )


def _share(before: Before) -> str:
    """The part of the homes, as the subject of a sentence: "All 200 homes", "50 of 200 homes"."""
    if len(before.seeds) < before.total:
        return f"{len(before.seeds)} of {plural(before.total, 'home')} from seed {FIRST_SEED} on"
    return f"All {plural(before.total, 'home')} from seed {FIRST_SEED} on"


def _entries() -> list[Entry]:
    """Lines of the ledger; none outside a checkout. Raises InvalidInput and Unavailable."""
    path = ledger.ledger_path()
    return [] if path is None else ledger.read(path)


def _before_run(records: Sequence[EpisodeRecord], run: Mapping[str, Any]) -> Before | None:
    """Earlier runs of the homes of a run; None if there are none.

    Raises InvalidInput and Unavailable for a ledger that cannot be read.
    """
    homes = _kept((r.preset, r.seed) for r in records)
    entries = _entries() if homes else []
    own = [e for e in entries if _is_own(e, records, run) or _is_of_a_commit(e, records)]
    found = _before([e for e in entries if e not in own and _is_earlier(e, own, run)], homes)
    return found and replace(found, release=_shared_release(found, run))


def _kept(homes: Iterable[Home]) -> set[Home]:
    return {(preset, seed) for preset, seed in homes if seed >= FIRST_SEED}


def _before(entries: Iterable[Entry], homes: set[Home]) -> Before | None:
    """The entries that name some of the homes, oldest first; None if there are none."""
    found, played = [], set[Home]()
    for entry in sorted(entries, key=lambda e: e.at):
        named = {h for h in homes if _names(entry, h)}
        if named:
            found.append(entry)
            played |= named
    if not found:
        return None
    return Before(tuple(found), tuple(sorted({seed for _, seed in played})), len(homes))


def _names(entry: Entry, home: Home) -> bool:
    """Whether an entry names a home. With realistic furniture a seed gives another home."""
    preset, seed = home
    return entry.preset == preset and entry.first_seed <= seed <= entry.last_seed


def _is_own(entry: Entry, records: Sequence[EpisodeRecord], run: Mapping[str, Any]) -> bool:
    """Whether an entry is a part of this run: same folder since its first start, same request, same
    code."""
    return (
        any(
            f.out == entry.out and (f.since is None or entry.at >= f.since) for f in folders_of(run)
        )
        and any(
            (order["benchmark"], order["preset"]) == (entry.benchmark, entry.preset)
            and set(entry.agents) <= set(order["agents"])
            and int(order["seed0"]) <= entry.first_seed
            and entry.last_seed < int(order["seed0"]) + int(order["episodes"])
            and _under_same_conditions(entry, order)
            for order in requests_of(run)
        )
        and not _was_played_anew(entry, records, run)
    )


def _was_played_anew(
    entry: Entry, records: Sequence[EpisodeRecord], run: Mapping[str, Any]
) -> bool:
    """Whether other code than that of the entry played all of the entry's episodes.

    The same code gives the same episodes again. Without a record of the entry, the commit of
    `run.json` decides.
    """
    commits = {r.commit for r in records if _has_episode(entry, r)}
    commits |= {str(run["commit"])} if run.get("commit") else set()
    return bool(commits) and not any(_is_same_code(entry.commit, c) for c in sorted(commits))


def _has_episode(entry: Entry, r: EpisodeRecord) -> bool:
    """Whether an entry names the episode of a record; one without conditions names any."""
    if not (
        _names(entry, (r.preset, r.seed))
        and r.agent in entry.agents
        and r.benchmark == entry.benchmark
    ):
        return False
    noise = r.noise.model_dump() if r.noise else None
    return entry.semantics is None or (
        (entry.semantics, entry.noise) == (r.semantics, noise)
        and r.settings.items() <= (entry.settings or {}).items()
    )


def _is_same_code(one: str, other: str) -> bool:
    """Whether two commits have the same code; marks of uncommitted changes do not count."""
    one, other = one.removesuffix(DIRTY), other.removesuffix(DIRTY)
    return one[:SHORT_COMMIT] == other[:SHORT_COMMIT] or same_code(one, other)


def _under_same_conditions(entry: Entry, order: Mapping[str, Any]) -> bool:
    """True also for an entry that lacks its conditions."""
    if entry.semantics is None:
        return True
    return (entry.semantics, entry.noise) == (order["semantics"], order["noise"]) and (
        (entry.settings or {}).items() <= order["settings"].items()
    )


def _shared_release(before: Before, run: Mapping[str, Any]) -> str:
    """Reason and commit of a run, if all earlier runs have the same; else empty."""
    why, commit = str(run.get("why") or ""), str(run.get("commit") or "")[:SHORT_COMMIT]
    same = all((e.why, e.commit[:SHORT_COMMIT]) == (why, commit) for e in before.entries)
    return f"{why}, commit {commit}" if same and why and commit else ""


def _is_of_a_commit(entry: Entry, records: Sequence[EpisodeRecord]) -> bool:
    return entry.by == AFTERWARDS and entry.commit in {r.commit for r in records}


def _is_earlier(entry: Entry, own: Sequence[Entry], run: Mapping[str, Any]) -> bool:
    """Whether an entry is from before the last part of a run.

    A run without a line and without a time is older than the ledger, so only lines that were
    entered afterwards are from before it.
    """
    last = max((e.at for e in own), default=run.get("started"))
    return entry.by == AFTERWARDS if last is None else entry.at <= str(last)


def _out_of(command: object) -> str | None:
    """Value of a command's --out; None without one."""
    if not isinstance(command, list):
        return None
    words = [str(word) for word in command]
    for word, after in zip(words, [*words[1:], ""], strict=True):
        if word == "--out":
            return after or None
        if word.startswith("--out="):
            return word.removeprefix("--out=")
    return None
