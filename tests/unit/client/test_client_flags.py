"""`helios up` checks the values of its flags before it starts anything."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import pytest
from helios_client import cli
from helios_client.supervision import flag_checks
from helios_client.supervision.service_specs import StackOptions
from helios_client.usage_errors import UsageError
from helios_detector.simulation.table_files import SCORERS, shipped_tables

from scripts.generate_example_flat import OUT as FLAT
from tests.support import free_port


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "mine_of_a_test.py").write_text("raise SystemExit('it was run')\n")
    (tmp_path / "nano.onnx").write_text("no model")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path


@pytest.fixture(autouse=True)
def started(monkeypatch: pytest.MonkeyPatch) -> list[StackOptions]:
    """Options of the stacks that `helios up` would have started."""
    stacks: list[StackOptions] = []
    monkeypatch.setattr("helios_client.supervision.up.up", lambda stack, *_: stacks.append(stack))
    return stacks


def test_valid_flags_pass_without_importing_a_plug_in() -> None:
    for robot in (*flag_checks.ROBOTS, "mine_of_a_test:Robot"):
        flag_checks.check_robot(robot)
    for detector in (
        "simulated",
        "ground-truth",
        "recorded",
        "onnx:nano.onnx",
        "transformers:a/b",
        "paint",
        "mine_of_a_test:Detector",
        "mine_of_a_test:Detector:0.5",
    ):
        flag_checks.check_detector(detector)
    for scorer in ("lexical", "minilm", "transformers:a/b", "mine_of_a_test:Scorer"):
        for robot in ("sim", "spot"):
            assert flag_checks.check_scorer(scorer, robot) == scorer
    for agent in ("helios", "vlfm", "mine_of_a_test:agent"):
        flag_checks.check_agent(agent)
    flag_checks.check_home("ovmm-v1", None)
    assert "mine_of_a_test" not in sys.modules


def test_names_ignore_case_and_are_returned_in_their_canonical_spelling() -> None:
    assert [flag_checks.check_robot(name) for name in ("SIM", "Spot")] == ["sim", "spot"]
    assert flag_checks.check_agent("VLFM_Helios_Stop") == "vlfm-helios-stop"
    assert flag_checks.check_detector("Ground Truth") == "ground-truth"
    assert flag_checks.check_detector("Paint") == "paint"  # from an installed package
    assert flag_checks.check_scorer("MiniLM", "sim") == "minilm"
    assert flag_checks.check_home("OVMM-V1", "Parametric") == ("ovmm-v1", "parametric")
    for own in ("mine_of_a_test:Robot", "mine_of_a_test:ROBOT"):
        assert flag_checks.check_robot(own) == own


@pytest.mark.parametrize(
    ("flag", "given", "said"),
    [
        ("--detector", "onnx:nan.onnx", "there is no such file; did you mean nano.onnx?"),
        ("--detector", "onnx:/nonexistent/x.onnx", "no such file; name an existing file"),
        ("--detector", "onnx:.", "that is a folder"),
        ("--detector", "onnx:", "names no file"),
        ("--detector", "onnx", "names no file"),
        ("--detector", "simulate", "no detector is called 'simulate'.*did you mean simulated"),
        ("--detector", "transformers:", "no package or module 'transformers'|is no package"),
        ("--detector", "mine_of_a_tset:X", "there is no package or module 'mine_of_a_tset'"),
        ("--detector", "mine_of_a_test:", "is no package:attribute"),
        ("--scorer", "lexicla", "no scorer is called 'lexicla'.*did you mean lexical"),
        ("--scorer", "simulate", "no scorer is called 'simulate'.*did you mean simulated"),
        ("--scorer", "simulated:itc-v2", "'itc-v2'; wanted itc-exact, itc-v1, .*mean itc-v1"),
        ("--scorer", "none_of_a_test:X", "no package or module 'none_of_a_test'"),
        ("--agent", "heliso", "no agent is called 'heliso'.*did you mean helios"),
        ("--agent", "none_of_a_test:agent", "no package or module 'none_of_a_test'"),
        ("--robot", "smi", "no robot is called 'smi'; wanted sim, .*did you mean sim"),
        ("--robot", "none_of_a_test:R", "no package or module 'none_of_a_test'"),
        ("--robot", "replay", "--robot replay needs --source"),
        ("--source", "/none.mcap", "--source is valid only with --robot replay, .* is sim"),
        ("--rate", "3", "--rate is valid only with --robot replay"),
        ("--preset", "demo-v2", "no preset is called 'demo-v2'; wanted demo-v1, ovmm-v1"),
        ("--furniture", "real", "no furniture is called 'real'"),
        ("--furniture", "realistic", "--furniture realistic: no realistic furniture in .*bake"),
    ],
)
def test_an_invalid_flag_value_is_a_usage_error_before_anything_starts(
    folder: Path, capsys: pytest.CaptureFixture[str], flag: str, given: str, said: str
) -> None:
    import re

    status = cli.run(
        ["up", flag, given, "--port", str(free_port()), "--state", str(folder / "state")]
    )
    assert status == 2
    error = capsys.readouterr().err
    assert re.search(said, error), error
    assert not (folder / "state").exists()


def test_a_robot_in_other_letters_has_its_default_detector(started: list[StackOptions]) -> None:
    assert cli.run(["up", "--robot", "SIM"]) == 0
    assert (started[0].robot, started[0].detector) == ("sim", "simulated")


@pytest.mark.parametrize("robot", ["spot", "remote", "mine_of_a_test:Robot"])
@pytest.mark.parametrize(
    "flags",
    [
        ("--preset", "nosuch"),
        ("--seed", "5"),
        ("--furniture", "realistic"),
        ("--home", str(FLAT)),
    ],
)
def test_flags_of_the_simulated_home_are_refused_for_another_robot(
    robot: str, flags: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(["up", "--robot", robot, "--detector", "paint", *flags]) == 2
    said = capsys.readouterr().err
    assert f"{flags[0]} is valid only with --robot sim, and --robot is {robot}" in said


def test_another_robot_takes_the_flags_of_the_simulated_home_with_their_defaults(
    started: list[StackOptions],
) -> None:
    flags = ("--seed", "0", "--preset", "demo-v1", "--rate", "1")
    assert cli.run(["up", "--robot", "bus", "--detector", "paint", *flags]) == 0
    assert started[0].robot == "bus"


def test_the_port_of_the_router_is_drawn_until_it_differs_from_that_of_the_gateway(
    started: list[StackOptions], monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = iter((18080, 18080, 18081))
    monkeypatch.setattr(socket.socket, "getsockname", lambda _: ("127.0.0.1", next(drawn)))
    assert cli.run(["up", "--port", "18080"]) == 0
    assert started[0].router_port == 18081


def test_the_scorer_flag_is_passed_to_the_detector_only_if_it_is_given() -> None:
    def argv(scorer: str | None) -> tuple[str, ...]:
        specs = StackOptions("sim", 7447, Path("state"), port=8080, scorer=scorer).processes()
        return next(spec.argv for spec in specs if spec.name == "detector")

    assert " ".join(argv("a:B")).endswith("--scorer a:B")
    assert "--scorer" not in argv(None)


def test_the_simulated_scorer_is_accepted_with_every_table_that_the_detector_has() -> None:
    tables = shipped_tables(SCORERS)
    assert "itc-v1" in tables
    for scorer in ("simulated", *(f"simulated:{table}" for table in tables)):
        assert flag_checks.check_scorer(scorer, "sim") == scorer
        assert flag_checks.check_scorer(scorer, "remote") == scorer  # it may run elsewhere
    assert flag_checks.check_scorer("Simulated:ITC_V1", "sim") == "simulated:itc-v1"
    Path("mine.toml").touch()
    assert flag_checks.check_scorer("simulated:mine.toml", "sim") == "simulated:mine.toml"


@pytest.mark.parametrize("robot", [r for r in flag_checks.ROBOTS if r not in ("sim", "remote")])
def test_the_simulated_scorer_is_refused_where_no_simulator_runs(robot: str) -> None:
    for scorer in ("simulated", "simulated:itc-v1", "simulated:unknown"):
        with pytest.raises(
            UsageError, match=f"--scorer {scorer} needs the simulator, and --robot is {robot}"
        ):
            flag_checks.check_scorer(scorer, robot)


def test_checking_the_simulated_scorer_imports_no_service() -> None:
    program = (
        "import sys\n"
        "from helios_client.supervision.flag_checks import check_scorer\n"
        "check_scorer('simulated:itc-v1', 'sim')\n"
        "print(*sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert not [name for name in done.stdout.split() if name.startswith("helios_detector")]


def test_an_unknown_detector_error_lists_the_installed_entry_points() -> None:
    with pytest.raises(
        UsageError, match=r"recorded, paint, onnx:FILE, transformers:ID, or package"
    ):
        flag_checks.check_detector("oracle")


def test_a_plan_is_checked_before_anything_starts(folder: Path) -> None:
    (folder / "old.sh3d").write_bytes(b"no zip")
    for preset, home, level, said in (
        ("demo-v1", Path("none.sh3d"), None, "does not exist"),
        ("demo-v1", Path("old.sh3d"), None, "no Sweet Home 3D file"),
        ("ovmm-v1", FLAT, None, "leave one out"),
        ("demo-v1", None, "Attic", "--home FILE.sh3d"),
        ("demo-v1", FLAT, "Attic", "has no level"),
    ):
        with pytest.raises(UsageError, match=said):
            flag_checks.check_plan(preset, home, level)
    name, remarks = flag_checks.check_plan("demo-v1", FLAT, None)
    assert remarks == []
    assert name.startswith("flat.sh3d@")
    assert flag_checks.check_plan("demo-v1", None, None) == ("", [])
    options = StackOptions(
        "sim", 7447, folder, port=8080, home=FLAT, level="Ground", home_name=name
    )
    by_name = {spec.name: spec.argv for spec in options.processes()}
    assert str(FLAT) in by_name["world"]
    assert "Ground" in by_name["world"]
    assert any(name in word for word in by_name["planner"])


@pytest.mark.parametrize(
    ("flags", "wrong"),
    [(["--router-port", "7448"], "--router-port"), (["--router-host", "0.0.0.0"], "--router-host")],
)
def test_the_flags_of_a_router_here_are_refused_with_a_router_elsewhere(
    flags: list[str], wrong: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    state = ["--state", str(folder / "state"), "--port", str(free_port())]
    services = ["--services", "planner", "--router", "10.0.0.2"]
    assert cli.run(["up", "--robot", "remote", *services, *flags, *state]) == 2
    said = capsys.readouterr().err
    assert f"{wrong} is for the router that this command starts" in said
    assert "--router HOST:PORT" in said
