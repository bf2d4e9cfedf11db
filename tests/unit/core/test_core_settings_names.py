"""An unknown setting is refused with the nearest one; other services' names are ignored."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from helios_core.errors import InvalidInput
from helios_core.settings import ServiceSettings, service_config
from helios_core.settings_spelling import SERVICES
from pydantic import Field, SecretStr

from tests.support import settings_of

MODULES = {name: f"helios_{name}" for name in SERVICES} | {"world": "helios_sim"}


class Settings(ServiceSettings):
    model_config = service_config("sample")

    cell_m: float = Field(default=0.025, gt=0, description="edge of a cell")


def refusal(argv: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The error message of a refused load."""
    with pytest.raises(SystemExit) as ended:
        Settings.load(argv)
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("helios-sample: ")
    assert said.count("\n") == 1
    return said


@pytest.mark.parametrize("name", ["HELIOS_SAMPLE_CEL_M", "helios_sample_cel_m"])
def test_an_unknown_variable_is_refused_with_the_nearest_setting(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(name, "0.05")
    assert "HELIOS_SAMPLE_CEL_M; did you mean HELIOS_SAMPLE_CELL_M?" in refusal([], capsys)


def test_without_a_near_setting_the_refusal_names_the_page_of_settings_and_no_values(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HELIOS_SAMPLE_QWRTZ", "hunter2")
    said = refusal([], capsys)
    assert "HELIOS_SAMPLE_QWRTZ" in said
    assert "docs/reference/settings.md" in said
    assert "hunter2" not in said


def test_settings_created_without_flags_refuse_an_unknown_variable_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A robot's driver creates its own settings in this way."""
    monkeypatch.setenv("HELIOS_SAMPLE_CEL_M", "0.05")
    with pytest.raises(InvalidInput, match="HELIOS_SAMPLE_CELL_M"):
        Settings()


def test_help_is_shown_despite_an_unknown_variable(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HELIOS_SAMPLE_CEL_M", "0.05")
    with pytest.raises(SystemExit) as ended:
        Settings.load(["--help"])
    assert ended.value.code == 0
    assert "--cell-m" in capsys.readouterr().out


def test_every_service_of_the_repository_is_known() -> None:
    root = Path(__file__).parents[3]
    found = set()
    for file in [*root.glob("services/*/settings.py"), *root.glob("clients/*/settings.py")]:
        found |= set(re.findall(r'service_config\("(\w+)"\)', file.read_text()))
    assert found == set(SERVICES)


@pytest.mark.parametrize("service", SERVICES)
def test_each_service_has_a_known_name_and_checks_only_its_own_variables(
    service: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = settings_of(MODULES[service])
    assert own.service_name() == service
    if service == "replay":
        monkeypatch.setenv("HELIOS_REPLAY_SOURCE", "recording.mcap")  # it has no default
    for name in ("TEST_SCREENSHOTS", "CONFIG_OF_MINE", "URL", "API_KEY", "RECORD", "HOME"):
        monkeypatch.setenv(f"HELIOS_{name}", "")
    for other in set(SERVICES) - {service}:
        monkeypatch.setenv(f"HELIOS_{other.upper()}_QWRTZ", "1")
    own()
    monkeypatch.setenv(f"HELIOS_{service.upper()}_ROBBOT", "ada")
    with pytest.raises(InvalidInput, match=f"HELIOS_{service.upper()}_ROBOT"):
        own()


def test_an_unknown_table_is_refused_with_the_nearest_one_and_the_list(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "helios.toml"
    file.write_text("[sample]\ncell_m = 0.1\n[map2dd]\ncell_m = 0.1\n")
    said = refusal(["--config", str(file)], capsys)
    assert f"{file} has a table [map2dd]" in said
    assert "did you mean [map2d]?" in said
    assert all(name in said for name in (*SERVICES, "all", "sample"))


def test_an_unknown_key_is_refused_with_the_nearest_setting(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "helios.toml"
    file.write_text("[sample]\ncel_m = 0.1\n")
    assert "is called cel_m; did you mean cell_m?" in refusal(["--config", str(file)], capsys)


def test_one_file_may_hold_the_tables_of_all_services(tmp_path: Path) -> None:
    file = tmp_path / "helios.toml"
    file.write_text("".join(f"[{name}]\nrobot = 'ada'\n" for name in (*SERVICES, "all")))
    assert Settings.load(["--config", str(file)]).robot == "ada"


@pytest.mark.parametrize("line", ["cell_m = 0.1", "sample = 0.1", "[[sample]]"])
def test_a_setting_outside_of_a_table_is_refused(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "helios.toml"
    file.write_text(f"{line}\n")
    assert "under the table of its service, such as [sample]" in refusal(
        ["--config", str(file)], capsys
    )


def test_an_unknown_log_level_is_refused_with_the_known_ones(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert "choose one of debug, info, warning, error" in refusal(["--log-level", "loud"], capsys)


def test_a_wrong_value_of_a_secret_is_never_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    class Keys(ServiceSettings):
        model_config = service_config("sample")
        token: SecretStr = SecretStr("")

    file = tmp_path / "settings.toml"
    file.write_text('[sample]\ntoken = ["hunter2"]\n')
    with pytest.raises(SystemExit) as ended:
        Keys.load(["--config", str(file)])
    said = capsys.readouterr().err
    assert (ended.value.code, "token" in said, "hunter2" in said) == (2, True, False)
