"""The optional language model: it rewrites sentences for the grammar, and may fail."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from helios_core.errors import InvalidInput
from helios_planner.instruction.language_model import LanguageModel
from helios_planner.instruction.parser import parse_with_help
from helios_planner.settings import Settings
from pydantic import SecretStr, ValidationError

GERMAN = "bewege die Tasse vom Tisch zum Sofa"
Reply = Callable[[dict], tuple[int, bytes]]


class Endpoint:
    """A chat-completions server on loopback; `reply` maps a request to (status, body), `location`
    is where it redirects to."""

    def __init__(self) -> None:
        self.reply: Reply = lambda _: (500, b"")
        self.location = ""
        self.heard: list[tuple[str, str, dict]] = []
        self.hold = threading.Event()
        self.hold.set()
        endpoint = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"] or 0)) or "{}")
                endpoint.heard.append((self.path, self.headers.get("Authorization", ""), body))
                endpoint.hold.wait(10)
                status, answer = endpoint.reply(body)
                self.send_response(status)
                self.send_header("Content-Length", str(len(answer)))
                if endpoint.location:
                    self.send_header("Location", endpoint.location)
                self.end_headers()
                self.wfile.write(answer)

            do_GET = do_POST  # what a followed redirect would send

            def log_message(self, format: str, *args: object) -> None:
                return

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/v1"

    def model(self, timeout_s: float = 5.0) -> LanguageModel:
        return LanguageModel(self.url, "tiny", "secret", timeout_s)


def replies_with(content: str) -> Reply:
    answer = {"choices": [{"message": {"role": "assistant", "content": content}}]}
    return lambda _: (200, json.dumps(answer).encode())


def serving() -> Iterator[Endpoint]:
    endpoint = Endpoint()
    thread = threading.Thread(target=endpoint.server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    yield endpoint
    endpoint.hold.set()
    endpoint.server.shutdown()
    endpoint.server.server_close()


endpoint = pytest.fixture(serving, name="endpoint")
other_endpoint = pytest.fixture(serving, name="other_endpoint")


def test_a_sentence_in_another_language_is_parsed_with_the_models_help(endpoint: Endpoint) -> None:
    endpoint.reply = replies_with('Sure: {"sentence": "Move the mug from the table to the sofa"}')
    got = parse_with_help(GERMAN, endpoint.model())
    assert (got.kind, got.object, got.start, got.goal) == ("move", "mug", "table", "sofa")
    path, key, body = endpoint.heard[0]
    assert (path, key) == ("/v1/chat/completions", "Bearer secret")
    assert body["model"] == "tiny"
    assert body["messages"][-1] == {"role": "user", "content": GERMAN}


def test_the_model_is_not_asked_about_sentences_that_the_grammar_decides(
    endpoint: Endpoint,
) -> None:
    parse_with_help("move the mug to the sofa", endpoint.model())
    for text in ("", "move the mug", "move the mug to the sofa and the bed", "x" * 10_000):
        with pytest.raises(InvalidInput):
            parse_with_help(text, endpoint.model())
    assert endpoint.heard == []


@pytest.mark.parametrize(
    ("reply", "why"),
    [
        (replies_with('{"missing": "the goal"}'), "it says: the goal"),
        (replies_with("I cannot do that"), "its answer is not what was asked for"),
        (replies_with('{"sentence": 7}'), "it has no sentence"),
        (replies_with("[1, 2]"), "its answer is not what was asked for"),
        (replies_with('{"a": ' + "[" * 60_000 + "}"), "its answer is not what was asked for"),
        (lambda _: (200, b"[" * 60_000), "its answer is not what was asked for"),
        (lambda _: (200, b"<html>"), "its answer is not what was asked for"),
        (lambda _: (200, b"{}"), "its answer is not what was asked for"),
        (lambda _: (503, b""), "it answered 503"),
        (lambda _: (200, b"x" * 100_000), "its answer is too long"),
    ],
)
def test_a_useless_answer_keeps_the_refusal_and_adds_its_reason(
    endpoint: Endpoint, reply: Reply, why: str
) -> None:
    endpoint.reply = reply
    with pytest.raises(InvalidInput) as refusal:
        parse_with_help(GERMAN, endpoint.model())
    assert "it looks like German" in refusal.value.message
    assert f"the language model tiny did not help: {why}" in refusal.value.message


@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
def test_a_redirect_is_refused_so_that_no_other_server_gets_the_key(
    endpoint: Endpoint, other_endpoint: Endpoint, status: int
) -> None:
    endpoint.reply = lambda _: (status, b"")
    endpoint.location = f"{other_endpoint.url}/chat/completions"
    with pytest.raises(InvalidInput) as refusal:
        parse_with_help(GERMAN, endpoint.model())
    assert f"it redirects to {endpoint.location!r}" in refusal.value.message
    assert "set HELIOS_PLANNER_LLM_URL" in refusal.value.message
    assert other_endpoint.heard == []


def test_the_models_sentence_is_parsed_by_the_same_grammar(endpoint: Endpoint) -> None:
    endpoint.reply = replies_with('{"sentence": "Move the mug and the bowl to the sofa"}')
    with pytest.raises(InvalidInput, match=r"several things.*read by the language model tiny"):
        parse_with_help(GERMAN, endpoint.model())


def test_a_slow_endpoint_times_out(endpoint: Endpoint) -> None:
    endpoint.hold.clear()
    with pytest.raises(InvalidInput, match=r"no answer within 0\.2 s"):
        parse_with_help(GERMAN, endpoint.model(timeout_s=0.2))


def test_an_unreachable_endpoint_is_reported() -> None:
    model = LanguageModel("http://127.0.0.1:9/v1", "tiny", "", 1.0)
    with pytest.raises(InvalidInput, match="it cannot be reached"):
        parse_with_help(GERMAN, model)


def test_an_invalid_address_is_reported() -> None:
    model = LanguageModel("http//127.0.0.1/v1", "tiny", "", 1.0)
    with pytest.raises(InvalidInput, match=r"its address .http//127\.0\.0\.1/v1. is none"):
        parse_with_help(GERMAN, model)


def test_without_an_endpoint_the_grammar_alone_decides() -> None:
    assert Settings().llm_url == ""
    with pytest.raises(InvalidInput, match="looks like German"):
        parse_with_help(GERMAN, None)


def test_a_key_is_not_shown_and_an_address_without_scheme_is_refused() -> None:
    settings = Settings(llm_key=SecretStr("hush"))
    assert "hush" not in repr(settings) + str(settings.described())
    with pytest.raises(ValidationError, match="llm_url"):
        Settings(llm_url="localhost:11434")


@pytest.mark.parametrize("key", ["ключ", "a\nb", "clé"])
def test_a_key_that_no_request_can_carry_is_refused_with_its_setting_and_not_shown(
    key: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HELIOS_PLANNER_LLM_KEY", key)
    with pytest.raises(SystemExit):
        Settings.load([])
    said = capsys.readouterr().err
    assert "llm_key: the key has characters that no HTTP header holds" in said
    assert key not in said
