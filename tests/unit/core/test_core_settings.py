"""Settings come from flags, then the environment, then the file; errors are reported."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from helios_core.agent_presets import service_settings
from helios_core.errors import InvalidInput
from helios_core.settings import (
    RobotNames,
    ServiceSettings,
    common_settings,
    is_chosen,
    service_config,
)
from pydantic import Field, SecretStr


class Settings(ServiceSettings):
    model_config = service_config("sample")

    cell_m: float = Field(default=0.025, gt=0, description="edge of a cell")


def test_defaults_hold_without_any_source() -> None:
    assert Settings.load([]).cell_m == 0.025


@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_number_that_is_not_finite_is_refused(
    value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        Settings.load(["--cell-m", value])
    assert "cell_m: Input should be a finite number" in capsys.readouterr().err


def test_a_flag_overrides_the_environment_and_the_environment_overrides_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "helios.toml"
    file.write_text("[sample]\ncell_m = 0.1\nrobot = 'spot'\n")
    monkeypatch.setenv("HELIOS_CONFIG", str(file))
    assert Settings.load([]).cell_m == 0.1
    monkeypatch.setenv("HELIOS_SAMPLE_CELL_M", "0.2")
    assert Settings.load([]).cell_m == 0.2
    loaded = Settings.load(["--cell-m", "0.3"])
    assert loaded.cell_m == 0.3
    assert loaded.robot == "spot"


def test_a_setting_is_chosen_by_its_variable_or_by_the_file_that_a_variable_names(
    tmp_path: Path,
) -> None:
    file = tmp_path / "helios.toml"
    file.write_text("[sample]\ncell_m = 0.1\n[other]\nwidth_m = 1.0\n")
    for environment, chosen in (
        ({}, False),
        ({"HELIOS_SAMPLE_CELL_M": "0.2"}, True),
        ({"helios_sample_cell_m": "0.2"}, True),
        ({"HELIOS_SAMPLE_ROBOT": "spot"}, False),
        ({"HELIOS_CONFIG": str(file)}, True),
        ({"HELIOS_SAMPLE_CONFIG": str(file)}, True),
        ({"HELIOS_CONFIG": str(tmp_path / "none.toml")}, False),
    ):
        assert is_chosen("sample", "cell_m", environment) is chosen
    assert not is_chosen("sample", "width_m", {"HELIOS_CONFIG": str(file)})


def test_the_agents_preset_applies_where_no_setting_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A flag overrides the environment, the environment the file, the file the agent's preset, and
    the preset the default."""

    class Planner(ServiceSettings):
        model_config = service_config("planner")

        agent: str = "helios"
        tau_g: float = 0.5

    file = tmp_path / "helios.toml"
    file.write_text("[planner]\ntau_g = 0.1\n")
    preset = service_settings("planner", "helios")["tau_g"]
    assert Planner.load(["--agent", "helios-paper"]).tau_g == 0.5
    assert Planner.load([]).tau_g == preset != 0.5
    monkeypatch.setenv("HELIOS_CONFIG", str(file))
    assert Planner.load([]).tau_g == 0.1
    monkeypatch.setenv("HELIOS_PLANNER_TAU_G", "0.2")
    assert Planner.load([]).tau_g == 0.2
    assert Planner.load(["--tau-g", "0.3"]).tau_g == 0.3
    assert Planner.load(["--tau-g", "0.5"]).tau_g == 0.5  # the default, because the flag gives it


@pytest.mark.parametrize("where", ["flag", "variable", "file"])
def test_the_agent_of_the_preset_may_be_set_by_flag_variable_or_file(
    where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Planner(ServiceSettings):
        model_config = service_config("planner")

        agent: str = "helios-paper"
        tau_g: float = 0.5

    (tmp_path / "helios.toml").write_text("[planner]\nagent = 'helios'\n")
    flags = ["--agent", "helios"] if where == "flag" else []
    if where == "variable":
        monkeypatch.setenv("HELIOS_PLANNER_AGENT", "helios")
    if where == "file":
        monkeypatch.setenv("HELIOS_CONFIG", str(tmp_path / "helios.toml"))
    assert Planner.load(flags).tau_g == service_settings("planner", "helios")["tau_g"]


@pytest.mark.parametrize("joined", [False, True])
def test_a_config_file_in_the_given_flags_overrides_the_command_line_and_environment(
    joined: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    named, other = tmp_path / "named.toml", tmp_path / "other.toml"
    named.write_text("[sample]\ncell_m = 0.1\n")
    other.write_text("[sample]\ncell_m = 0.2\nrobot = 'spot'\n")
    monkeypatch.setenv("HELIOS_CONFIG", str(other))
    monkeypatch.setattr("sys.argv", ["helios-sample", "--config", str(other)])
    flags = [f"--config={named}"] if joined else ["--config", str(named)]
    loaded = Settings.load(flags)
    assert (loaded.cell_m, loaded.robot, loaded.config) == (0.1, "robot", named)


def test_given_flags_replace_the_command_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["helios-sample", "--config", "/nowhere/helios.toml"])
    assert Settings.load([]).cell_m == 0.025


def test_a_missing_config_file_exits_with_2(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        Settings.load(["--config", "/nowhere/helios.toml"])
    assert ended.value.code == 2
    assert "/nowhere/helios.toml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[sample\ncell_m = 1\n", "is no TOML: Expected ']'"),
        (b"[sample]\ncell_m = \n", "(at line 2, column 10)"),
        (b"[sample]\nname = '\xff'\n", "is no UTF-8 text"),
    ],
)
def test_an_invalid_toml_file_is_reported_with_path_and_line(
    content: bytes, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "helios.toml"
    file.write_bytes(content)
    with pytest.raises(SystemExit) as ended:
        Settings.load(["--config", str(file)])
    assert ended.value.code == 2
    reported = capsys.readouterr().err
    assert f"{file} is no " in reported
    assert words in reported


def test_the_table_all_applies_where_the_services_own_table_sets_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "helios.toml"
    file.write_text("[all]\nrouter = 'tcp/hub:7447'\nrobot = 'ada'\n[sample]\nrobot = 'bob'\n")
    monkeypatch.setenv("HELIOS_CONFIG", str(file))
    loaded = Settings.load([])
    assert (loaded.router, loaded.robot) == ("tcp/hub:7447", "bob")


def test_the_table_all_refuses_settings_of_a_single_service(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "helios.toml"
    file.write_text("[all]\ncell_m = 0.1\n")
    monkeypatch.setenv("HELIOS_CONFIG", str(file))
    with pytest.raises(SystemExit) as ended:
        Settings.load([])
    assert ended.value.code == 2
    assert "[all]" in (said := capsys.readouterr().err)
    assert "cell_m" in said
    assert "router" in said


@pytest.mark.parametrize("argv", [["--cell-m", "-1"], ["--cell-m", "wide"], ["--no-such-flag"]])
def test_invalid_flags_exit_with_2(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        Settings.load(argv)
    assert ended.value.code == 2
    assert "helios-sample" in capsys.readouterr().err


def test_a_wrong_setting_is_reported_without_the_words_of_the_library(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HELIOS_SAMPLE_LOG_LEVEL", "loud")
    with pytest.raises(SystemExit):
        Settings.load([])
    said = "no log level is called 'loud'; choose one of debug, info, warning, error"
    assert f"wrong setting: log_level: {said} (got 'loud')" in capsys.readouterr().err
    with pytest.raises(InvalidInput, match=f"wrong setting of sample: log_level: {said}"):
        Settings.read()
    with pytest.raises(InvalidInput, match=f"wrong setting of sample: {said}"):
        common_settings("sample", os.environ)


def test_given_values_override_the_environment_that_a_program_without_flags_reads(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("HELIOS_SAMPLE_CELL_M", "0.2")
    assert Settings.read().cell_m == 0.2
    assert Settings.read(cell_m=0.3).cell_m == 0.3


def test_wrong_variables_are_named_without_their_values(monkeypatch: pytest.MonkeyPatch) -> None:
    class WithTable(Settings):
        table: dict[str, float] = Field(default={}, description="a table")

    monkeypatch.setenv("HELIOS_SAMPLE_CELL_M", "wide")
    with pytest.raises(
        InvalidInput, match=r"wrong setting of sample: cell_m.*HELIOS_SAMPLE_"
    ) as no:
        WithTable.read()
    assert "wide" not in no.value.message
    monkeypatch.setenv("HELIOS_SAMPLE_TABLE", "12,5")
    with pytest.raises(InvalidInput, match=r'cannot read the settings of sample.*"table"') as no:
        WithTable.read()
    assert "12,5" not in no.value.message


def test_settings_cannot_be_changed() -> None:
    name = "cell_m"
    with pytest.raises(Exception, match="frozen"):
        setattr(Settings.load([]), name, 1.0)


def test_a_service_reports_its_settings_with_descriptions_and_without_secrets() -> None:
    class Secretive(ServiceSettings):
        model_config = service_config("secretive")

        speed_m_s: float = Field(default=0.5, description="at most")
        password: SecretStr = Field(default=SecretStr("swordfish"), description="of the user")

    reported = json.dumps(Secretive.load(["--speed-m-s", "0.2"]).described())
    assert json.loads(reported)["speed_m_s"] == {
        "value": 0.2,
        "default": 0.5,
        "description": "at most",
    }
    assert "swordfish" not in reported


def test_a_setting_without_a_default_is_reported_with_default_none() -> None:
    class Needy(ServiceSettings):
        source: str = Field(description="to be named")

    reported = Needy.load(["--source", "here"]).described()
    assert (reported["source"]["value"], reported["source"]["default"]) == ("here", None)


class ForSeveral(Settings):
    robots: RobotNames = Field(default="", description="further robots")


def test_robot_names_are_normalised_and_checked_when_settings_load(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert ForSeveral.load(["--robots", " ada, bob,,ada"]).robots == "ada,bob"
    for name in ("a/b", "*", "two words", "_mine", "a$b", "any"):
        for flag in ("--robot", "--robots"):
            with pytest.raises(SystemExit) as ended:
                ForSeveral.load([flag, name])
            assert ended.value.code == 2
            assert "no robot can be called" in capsys.readouterr().err
