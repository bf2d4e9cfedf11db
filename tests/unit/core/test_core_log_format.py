"""Log lines: text for people, or one JSON object per line with the ids of the work."""

from __future__ import annotations

import json
import logging
import re
import subprocess
import sys

import pytest
from helios_core import log_format, tracing
from helios_core.log_format import JsonLines, OneService
from helios_core.settings import ServiceSettings
from hypothesis import given
from hypothesis import strategies as st

CODE = """
import logging
from helios_core import log_format, tracing
log_format.configure("map2d", "r", "info", "{form}")
with tracing.span("a", task="t", keyframe="k"):
    logging.getLogger("x").info("two\\nlines")
"""


def line(message: str, *args: object, error: BaseException | None = None) -> dict[str, str]:
    info = (type(error), error, error.__traceback__) if error else None
    record = logging.LogRecord("a.b", logging.WARNING, "f.py", 1, message, args, info)
    OneService("planner").filter(record)
    text = JsonLines("r").format(record)
    assert "\n" not in text
    return json.loads(text)


def run(form: str) -> str:
    code = CODE.format(form=form)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stderr


def test_a_line_names_service_robot_and_level() -> None:
    said = line("%d objects", 3)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}\+00:00", said.pop("time"))
    assert said == {
        "level": "warning",
        "service": "planner",
        "robot": "r",
        "logger": "a.b",
        "message": "3 objects",
    }


def test_a_line_names_the_task_and_keyframe_of_the_work() -> None:
    with tracing.span("work", task="c0ffee", keyframe="ab/0/7"):
        said = line("a")
    assert (said["task"], said["keyframe"]) == ("c0ffee", "ab/0/7")
    assert "task" not in line("a")


def test_a_line_holds_the_traceback_of_an_exception() -> None:
    with pytest.raises(ValueError, match="no mug") as caught:
        raise ValueError("no mug")
    assert "ValueError: no mug" in line("a", error=caught.value)["exception"]


@given(st.text())
def test_any_message_is_one_line(message: str) -> None:
    assert line("%s", message)["message"] == message


def test_a_process_writes_text_or_json_to_standard_error() -> None:
    assert re.fullmatch(r"[-\d]+ [:,\d]+ map2d INFO two\nlines\n", run("text"))
    said = json.loads(run("json"))
    assert (said["message"], said["task"], said["keyframe"]) == ("two\nlines", "t", "k")


def test_an_unknown_form_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="choose one of text, json"):
        ServiceSettings(log_format="yaml")
    assert ServiceSettings(log_format="JSON").log_format == "json"
    assert ServiceSettings().log_format == log_format.LOG_FORMATS[0] == "text"
