"""Client of a language model that may rephrase sentences which the grammar does not recognise.

The model answers with one plain English sentence, which the same grammar parses: no answer bypasses
`instruction.parse`. Any server with OpenAI's chat completions API works, local or remote; without
one only this help is missing.
"""

from __future__ import annotations

import json
import time
import urllib.error
import urllib.request
from dataclasses import dataclass
from http.client import HTTPException

from helios_planner.settings import Settings

LONGEST_ANSWER_BYTES = 65_536
TASK = """You translate what a person tells a household robot into one plain English sentence.
Answer with one JSON object and nothing else. Either
{"sentence": "Move the OBJECT from the START to the GOAL"} (leave out "from the START" if unsaid),
{"sentence": "Find the OBJECT"}, {"sentence": "Go to the PLACE"}, {"sentence": "Go to X, Y"} for a
point given in metres, {"sentence": "Explore the home"}, {"sentence": "Come back"}, or
{"missing": "what is unclear, in a few words"} if the person did not say one object and one place.
START, GOAL and PLACE are pieces of furniture. Invent nothing."""


class NoHelp(Exception):
    """Raised if the model gave no usable answer; the message is the reason, in one clause."""


@dataclass(frozen=True)
class LanguageModel:
    """One OpenAI-compatible endpoint. url: up to and with `/v1`."""

    url: str
    model: str
    key: str
    timeout_s: float

    def plain_sentence(self, text: str) -> str:
        """The text as one plain English sentence. Raises NoHelp within about `timeout_s`."""
        body = {
            "model": self.model,
            "temperature": 0,
            "max_tokens": 120,
            "messages": [
                {"role": "system", "content": TASK},
                {"role": "user", "content": text},
            ],
        }
        try:
            answer = json.loads(self._post(json.dumps(body).encode()))
            said = answer["choices"][0]["message"]["content"]
            found = json.loads(said[said.index("{") : said.rindex("}") + 1])
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
            raise NoHelp("its answer is not what was asked for") from error
        sentence = found.get("sentence")
        if isinstance(sentence, str) and sentence:
            return sentence
        missing = found.get("missing")
        raise NoHelp(f"it says: {missing}" if isinstance(missing, str) else "it has no sentence")

    def _post(self, body: bytes) -> bytes:
        headers = {"Content-Type": "application/json"}
        if self.key:
            headers["Authorization"] = f"Bearer {self.key}"
        url = f"{self.url.rstrip('/')}/chat/completions"
        try:
            request = urllib.request.Request(url, data=body, headers=headers, method="POST")
        except ValueError as error:
            raise NoHelp(f"its address {self.url!r} is none") from error
        deadline_s = time.monotonic() + self.timeout_s
        parts: list[bytes] = []
        try:
            with _opener().open(request, timeout=self.timeout_s) as response:
                while part := response.read1(8192):
                    parts.append(part)
                    if time.monotonic() > deadline_s:
                        raise TimeoutError
                    if sum(map(len, parts)) > LONGEST_ANSWER_BYTES:
                        raise NoHelp("its answer is too long")
        except urllib.error.HTTPError as error:
            if (target := error.headers.get("Location")) and error.code < 400:
                raise NoHelp(
                    f"it redirects to {target!r:.200}, which gets neither the sentence nor the "
                    "key; set HELIOS_PLANNER_LLM_URL to that server if you trust it"
                ) from error
            raise NoHelp(f"it answered {error.code} {error.reason}") from error
        except (OSError, HTTPException) as error:
            late = isinstance(error, TimeoutError) or isinstance(
                getattr(error, "reason", None), TimeoutError
            )
            why = f"no answer within {self.timeout_s:g} s" if late else "it cannot be reached"
            raise NoHelp(why) from error
        return b"".join(parts)


def _opener() -> urllib.request.OpenerDirector:
    """Opener without proxies that treats a redirect as an error: urllib would send the key on."""
    opener = urllib.request.OpenerDirector()
    opener.add_handler(urllib.request.HTTPHandler())
    opener.add_handler(urllib.request.HTTPSHandler())
    opener.add_handler(urllib.request.HTTPErrorProcessor())
    opener.add_handler(urllib.request.HTTPDefaultErrorHandler())
    return opener


def language_model(settings: Settings) -> LanguageModel | None:
    """The model of the settings; None if they name none."""
    s = settings
    key = s.llm_key.get_secret_value()
    return LanguageModel(s.llm_url, s.llm_model, key, s.llm_timeout_s) if s.llm_url else None
