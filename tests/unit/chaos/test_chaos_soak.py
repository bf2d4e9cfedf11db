"""`helios soak` finds out at its start what would lose the result, and writes it first."""

from __future__ import annotations

import json
import sys
from contextlib import nullcontext
from pathlib import Path
from unittest.mock import Mock

import pytest
from helios_chaos import soak_run
from helios_client import cli


@pytest.mark.parametrize("load", [(), ("--load",)])
def test_an_unusable_folder_is_refused_before_the_run(
    load: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    for out, reason in (("file", "File exists"), ("file/deeper", "Not a directory")):
        assert cli.run(["soak", "--out", str(tmp_path / out), *load]) == 2
        said = capsys.readouterr().err
        assert f"the folder {tmp_path / out} cannot be made: {reason}; choose another" in said


def test_a_missing_plotting_package_is_reported_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    began = Mock(side_effect=AssertionError("it was started"))
    monkeypatch.setattr("helios_chaos.stack.running_stack", began)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    for module in ("soak_run", "soak_plot"):
        monkeypatch.delitem(sys.modules, f"helios_chaos.{module}", raising=False)
    assert cli.run(["soak", "--out", str(tmp_path / "soak")]) == 1
    assert "pip install 'helios-ovmm[all]'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_the_result_is_written_before_the_plot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = Mock(**{"close.return_value": []})
    monkeypatch.setattr(soak_run, "running_stack", lambda _: nullcontext((Mock(), [])))
    monkeypatch.setattr(soak_run, "ResourceLog", lambda *_: log)
    monkeypatch.setattr(soak_run, "_play", lambda *_: [])
    monkeypatch.setattr(soak_run, "plot", Mock(side_effect=RuntimeError("no font")))
    with pytest.raises(RuntimeError, match="no font"):
        soak_run.run_soak(1.0, 0, tmp_path, lambda _: None)
    assert json.loads((tmp_path / "soak.json").read_text())["tasks"] == 0
