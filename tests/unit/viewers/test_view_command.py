"""`helios view` refuses wrong use in one sentence."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from helios_client import cli

from tests.support import free_port
from tests.unit.viewers.viewed_robot import say_of


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        ((), 2, "--foxglove, --rerun or both"),
        (("--foxglove", "nowhere.mcap"), 2, "there is no recording nowhere.mcap"),
        (("--foxglove", "--save", "x.rrd"), 2, "--save is valid only with --rerun"),
        (("--foxglove", __file__), 1, "is no MCAP file"),
    ],
)
def test_wrong_use_is_refused(args: tuple[str, ...], code: int, words: str) -> None:
    assert_one_sentence(say_of(*args), code, words)


def test_without_a_running_robot_it_says_how_to_name_one(tmp_path: Path) -> None:
    assert_one_sentence(say_of("--foxglove", "--state", str(tmp_path)), 1, "--router")


def test_without_a_router_no_viewer_is_told_to_connect() -> None:
    nobody = f"tcp/127.0.0.1:{free_port()}"
    assert_one_sentence(say_of("--foxglove", "--router", nobody), 1, "no router at")


@pytest.mark.parametrize("extra", ["foxglove", "rerun"])
def test_a_missing_extra_is_named(
    extra: str, recorded: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, extra, None)
    for name in [m for m in sys.modules if m.startswith("helios_viewers.")]:
        monkeypatch.delitem(sys.modules, name)
    assert cli.run(["view", str(recorded), f"--{extra}"]) == 1
    assert f"pip install 'helios-ovmm[{extra}]'" in capsys.readouterr().err


def assert_one_sentence(ended: tuple[int, str], code: int, words: str) -> None:
    assert ended[0] == code
    assert words in ended[1]
    assert ended[1].count("\n") == 1
