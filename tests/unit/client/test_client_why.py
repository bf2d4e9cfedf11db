"""`helios why`: its text output and its JSON output."""

from __future__ import annotations

import io
import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest
from helios_client.answer_types import Decision, Task
from helios_client.cli import run
from helios_client.commands.decision_view import report
from rich.console import Console

TASK: dict[str, Any] = {
    "id": "abc123",
    "instruction": "Move the mug from the coffee table to the counter",
    "state": "succeeded",
    "message": "put the mug on the counter",
    "steps": 143,
    "started_s": 100.0,
    "created_s": 99.0,
}


def candidate(kind: str, name: str, chosen: bool = False, **terms: float) -> dict[str, Any]:
    return {"kind": kind, "name": name, "terms": terms, "chosen": chosen}


TABLE = candidate(
    "receptacle",
    "coffee table",
    True,
    class_score=0.62,
    information_gain=1.2,
    distance_m=3.1,
    total=0.741,
)
FRONTIERS = [
    candidate(
        "frontier",
        f"frontier {k}",
        value=0.2,
        frontier_scale=1.0,
        distance_m=2.3,
        total=0.2 - k / 100,
    )
    for k in range(1, 6)
]
SEARCH: dict[str, Any] = {
    "index": 0,
    "phase": "find_object",
    "rule": "global search (eq. 8-10)",
    "made_s": 112.4,
    "why": "search the coffee table, 3.1 m away: worth 0.741; next frontier 1 with 0.190",
    "candidates": [*FRONTIERS, TABLE],
}
PICK: dict[str, Any] = {
    "index": 1,
    "phase": "pick",
    "rule": "pick (eq. 7, 11)",
    "made_s": 130.0,
    "why": "pick the mug, 1.2 m away: score 0.55 ≥ 0.50 after 4 views",
    "candidates": [candidate("object", "mug", True, score=0.55, views=4, in_place=1, total=0.55)],
}
FLIPPED = {
    "do": "go_to_frontier",
    "why": "explore frontier 1, 2.3 m away: worth 0.180",
    "candidates": [],
    "flips": True,
    "certain": True,
}
STAYS = {"do": "act", "why": PICK["why"], "candidates": [], "flips": False, "certain": True}


def shown(
    decisions: list[dict[str, Any]],
    changes: tuple[str, ...] = (),
    top: int = 3,
    everything: bool = False,
    width: int = 110,
    task: dict[str, Any] = TASK,
) -> str:
    out = io.StringIO()
    console = Console(file=out, width=width, color_system=None)
    reported = [Decision.from_json(d) for d in decisions]
    console.print(report(Task.from_json(task), reported, changes, top, everything))
    return out.getvalue()


def test_each_decision_is_shown_with_its_sentence_time_and_best_candidates() -> None:
    lines = shown([SEARCH, PICK]).splitlines()
    assert lines[0] == TASK["instruction"]
    assert lines[1] == "succeeded: put the mug on the counter"
    assert " ".join(lines[2].split()) == "task abc123, 143 steps, 2 decisions"
    assert "find object" in lines
    sentence = next(line for line in lines if "search the coffee table" in line)
    assert sentence.split()[:3] == ["0", "12", "s"]
    rows = [line.split() for line in lines]
    assert ["›", "coffee", "table", "0.620", "1.200", "3.1", "m", "0.741"] in rows
    assert ["and", "3", "more"] in rows
    assert ["›", "mug", "4", "yes", "0.550"] in rows, "a total that is the score is said once"


MANY_TERMS = {
    "class_score": 0.62,
    "uncertainty": 0.11,
    "information_gain": 1.234,
    "distance_m": 12.3,
    "views": 14,
    "in_place": 1,
    "place": 0.87,
    "score": 0.55,
    "score_after_view": 0.71,
    "total": 0.7412,
}
WIDE = PICK | {
    "candidates": [candidate("object", "television stand", k == 4, **MANY_TERMS) for k in range(6)]
}


def test_counts_of_one_are_printed_in_the_singular() -> None:
    text = shown([PICK | {"recomputed": FLIPPED}], ("alpha_d=0.1",), task=TASK | {"steps": 1})
    assert "task abc123, 1 step, 1 decision" in text
    assert "1 of 1 decision would flip" in text


@pytest.mark.parametrize("width", [60, 72, 80, 100, 200])
def test_a_narrow_terminal_truncates_no_name_and_no_number(width: int) -> None:
    lines = shown([SEARCH, WIDE], width=width).splitlines()
    assert all(len(line) <= width for line in lines)
    text = " ".join(" ".join(lines).split())
    for word in ("frontier 1", "1.234", "12.3 m", "0.741", "0.870", "and 2 more"):
        assert word in text
    assert "…" not in text
    if width >= 72:  # narrower terminals wrap long names
        assert text.count("television") == 4


def test_the_terms_of_a_search_stay_in_columns_on_a_terminal_of_80_columns() -> None:
    rows = [line.split() for line in shown([SEARCH], width=80).splitlines()]
    assert ["›", "coffee", "table", "0.620", "1.200", "3.1", "m", "0.741"] in rows


def test_top_0_prints_only_the_sentences() -> None:
    text = shown([SEARCH, PICK], top=0)
    assert "and 3 more" not in text
    assert "search the coffee table" in text


def test_changed_settings_show_only_the_decisions_that_would_flip() -> None:
    decisions = [SEARCH | {"recomputed": FLIPPED}, PICK | {"recomputed": STAYS}]
    text = shown(decisions, ("alpha_d=0.1",))
    assert "under alpha_d=0.1 1 of 2 decisions would flip" in text
    assert "would explore frontier 1, 2.3 m away: worth 0.180" in text
    assert "pick the mug" not in text
    everything = shown(decisions, ("alpha_d=0.1",), everything=True)
    assert "pick the mug" in everything
    assert "would stay the same" in everything


def test_an_uncertain_recomputation_is_marked() -> None:
    unsure = PICK | {"recomputed": STAYS | {"certain": False}}
    text = shown([unsure], ("tau_g=0.9",))
    assert "1 depends on values not queried at the time" in text
    assert "unknown: not queried at the time" in text


def test_markup_in_a_decision_is_printed_literally() -> None:
    odd = PICK | {"why": "pick the [red] mug: [bold]"}
    assert "pick the [red] mug: [bold]" in shown([odd])


@pytest.fixture
def port() -> Iterator[int]:
    """A gateway with one task; with `set` its decisions are recomputed."""

    class Gateway(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            url = urlsplit(self.path)
            if url.path.endswith("/decisions"):
                set_ = parse_qs(url.query).get("set", [])
                again = {"recomputed": FLIPPED} if set_ == ["alpha_d=0.1", "tau_g=0.4"] else {}
                body: Any = {"decisions": [SEARCH | again]}
            elif url.path.endswith("/tasks"):
                body = {"tasks": [TASK]}
            else:
                body = TASK
            data = json.dumps(body).encode()
            self.send_response(200)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, format: str, *args: object) -> None:
            return

    server = ThreadingHTTPServer(("127.0.0.1", 0), Gateway)
    threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
    yield server.server_port
    server.shutdown()
    server.server_close()


def test_the_command_accepts_an_id_prefix_or_last(
    port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    for task in ("abc", "last"):
        assert run(["why", task, "--port", str(port)]) == 0
        assert "search the coffee table" in capsys.readouterr().out
    assert run(["why", "nobody", "--port", str(port)]) == 2
    assert "there is no task 'nobody'" in capsys.readouterr().err


def test_json_contains_the_decisions_and_the_number_of_flips(
    port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    sets = ["--set", "alpha_d=0.1", "--set", "tau_g=0.4"]
    assert run(["why", "abc", "--json", "--port", str(port), *sets]) == 0
    reported = json.loads(capsys.readouterr().out)
    assert reported["task"]["id"] == "abc123"
    assert reported["flips"] == 1
    assert reported["decisions"][0]["recomputed"]["why"] == FLIPPED["why"]
