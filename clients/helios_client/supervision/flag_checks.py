"""Checks of the flags of `helios up` and `helios replay`, before any process starts.

They load no model and run no plug-in code. The service does that, and reports further errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from helios_core import plugins
from helios_core.agent_presets import AGENT_NAMES
from helios_core.errors import HeliosError, InvalidInput, Unavailable
from helios_core.log_format import LOG_FORMATS
from helios_core.models.catalogue import known, missing_sentence
from helios_core.models.model_folder import onnx_file
from helios_core.name_rules import robot_name, same_name
from helios_core.settings_spelling import nearest

from helios_client.supervision.service_specs import LOOPBACK, RECORDED_DETECTOR, REMOTE
from helios_client.usage_errors import UsageError

ROBOTS = ("sim", "replay", "spot", "ros2", "bus", "push", REMOTE)
_DETECTORS = ("simulated", "ground-truth", RECORDED_DETECTOR)
_SIMULATED = "simulated"  # detector, and scorer; the scorer also simulated:TABLE
_SCORERS = ("lexical", "minilm", _SIMULATED)
_WITH_A_WORLD = ("sim", REMOTE)  # robots; the simulator may run on the other machine
ROUTER_HOSTS = (LOOPBACK, "0.0.0.0", "::")
FURNITURE = ("parametric", "realistic")
DEFAULT_PRESET = "demo-v1"
LIKE_PLANS = "ovmm-v1"  # preset whose noise and number of actions the home of a plan has
_OF_ONE_ROBOT: dict[str, tuple[str, object]] = {  # flag -> its robot, and its default
    "spot_host": ("spot", None),
    "source": ("replay", None),
    "rate": ("replay", 1.0),
    "seed": ("sim", 0),
    "preset": ("sim", DEFAULT_PRESET),
    "home": ("sim", None),
    "furniture": ("sim", None),
}


def check_robot(robot: str) -> str:
    """Robot as the services spell it. Raises UsageError."""
    return _check(plugins.ROBOTS, robot, ROBOTS, "")


def check_name(name: str) -> None:
    """Raise UsageError for a name that no robot can have on the bus."""
    try:
        robot_name(name)
    except InvalidInput as error:
        raise UsageError(f"--name: {error.message}") from error


def check_log_format(name: str) -> str:
    """Log format as the services spell it. Raises UsageError."""
    if name.lower() not in LOG_FORMATS:
        raise UsageError(f"--log-format is {name!r}; choose one of {', '.join(LOG_FORMATS)}")
    return name.lower()


def check_together(robot: str, given: Mapping[str, object]) -> None:
    """Raise UsageError for a flag that does not belong to this robot, or that it lacks.

    robot: as `check_robot` returns it. given: values of the flags of `helios up`, by name.
    """
    for name, (wanted, default) in _OF_ONE_ROBOT.items():
        if robot != wanted and given[name] != default:
            flag = f"--{name.replace('_', '-')}"
            raise UsageError(f"{flag} is valid only with --robot {wanted}, and --robot is {robot}")
    if robot == "replay" and given["source"] is None:
        raise UsageError("--robot replay needs --source, the recording or data set to play")


def check_router(host: str, certs: Path | None) -> None:
    """Raise UsageError for an address that the services of this machine could not reach, and if
    the router would be open to other machines without certificates."""
    if host not in ROUTER_HOSTS:
        raise UsageError(
            f"--router-host {host} does not work here; wanted {LOOPBACK} for this machine alone, "
            "or 0.0.0.0 for other machines, too"
        )
    if certs is None and host != LOOPBACK:
        raise UsageError(
            f"--router-host {host} opens the bus to other machines, so certificates are needed: "
            "helios certs init DIR, then --certs DIR"
        )


def check_no_own_router(host: str, port: int | None) -> None:
    """Raise UsageError for a flag of the router of this machine, while another one is used."""
    for flag, given in (("--router-port", port is not None), ("--router-host", host != LOOPBACK)):
        if given:
            raise UsageError(
                f"{flag} is for the router that this command starts, and --router names one "
                "elsewhere; give its port with --router HOST:PORT"
            )


def check_source(source: Path) -> None:
    """Raise UsageError if the source does not exist. Its format is checked later."""
    if not source.exists():
        raise UsageError(
            f"there is no data set at {source}; name a recording (.mcap), a data set or a ROS bag"
        )


def default_detector(robot: str, source: Path | None) -> str:
    """Default detector of `helios up`. robot: as `check_robot` returns it. Raises UsageError if the
    user must name one."""
    if robot == "sim":
        return _SIMULATED
    if robot == "replay" and source is not None:
        from helios_replay.format_detection import is_recording

        if is_recording(source):
            return RECORDED_DETECTOR
    raise UsageError(f"--robot {robot} needs a detector; name one with --detector onnx:FILE")


def check_detector(detector: str) -> str:
    """Detector as the services spell it. Checks that the name can exist, and that a model file
    does. Raises UsageError, or Unavailable for a recommended model that is not fetched."""
    kind, _, model = detector.partition(":")
    if kind == "onnx":
        _check_model(model)
    elif not (kind == "transformers" and model):
        return _check(plugins.DETECTORS, detector, _DETECTORS, "onnx:FILE, transformers:ID, ")
    return detector


def check_scorer(scorer: str, robot: str) -> str:
    """Scorer as the services spell it. robot: as `check_robot` returns it. Raises UsageError."""
    kind, _, model = scorer.partition(":")
    if kind == "transformers" and model:
        return scorer
    if same_name(kind, (_SIMULATED,)):
        return _check_simulated(scorer, model, robot)
    return _check(plugins.SCORERS, scorer, _SCORERS, "transformers:ID, ")


def check_agent(agent: str) -> str:
    """Agent as the services spell it. Raises UsageError."""
    return _check(plugins.AGENTS, agent, AGENT_NAMES, "")


def check_home(preset: str, furniture: str | None) -> tuple[str, str | None]:
    """Preset and furniture as the simulator spells them.

    Raises UsageError, also for realistic furniture that has not been baked.
    """
    if furniture is not None:
        known = same_name(furniture, FURNITURE)
        if known is None:
            wanted = " or ".join(FURNITURE)
            raise UsageError(f"no furniture is called {furniture!r}; wanted {wanted}")
        furniture = known
    if preset != DEFAULT_PRESET:
        from helios_sim.home.presets import PRESETS  # late import: it takes half a second

        known = same_name(preset, PRESETS)
        if known is None:
            raise UsageError(_none_called("preset", preset, tuple(PRESETS), ""))
        preset = known
    if furniture == "realistic":
        from helios_sim.assets import asset_pack

        try:
            asset_pack.read_index(asset_pack.default_cache() / "current")
        except HeliosError as error:
            raise UsageError(f"--furniture realistic: {error.message}") from error
    return preset, furniture


def check_plan(preset: str, home: Path | None, level: str | None) -> tuple[str, list[str]]:
    """Name of a plan with a digest of its content, and sentences on rooms that the robot cannot
    reach; empty without a plan.

    Raises UsageError for a plan that cannot be used, and for flags that contradict it.
    """
    if home is None:
        if level is not None:
            raise UsageError(f"--level {level} came without a plan; add --home FILE.sh3d")
        return "", []
    if preset != DEFAULT_PRESET:
        raise UsageError(f"--home {home} and --preset {preset} both name the home; leave one out")
    try:
        # late imports: they take half a second
        from helios_sim.plans import PlanSource, drawn_home
        from helios_sim.plans.plan_summary import unreachable_sentences
    except ImportError as error:
        raise UsageError(
            f"--home needs the simulator ({error}): pip install 'helios-ovmm[sim]'"
        ) from error
    try:
        source = PlanSource.of(home, level or "")
        remarks = unreachable_sentences(drawn_home(source))
    except HeliosError as error:
        raise UsageError(f"--home: {error.message}") from error
    return source.kind, remarks


def _check_simulated(scorer: str, table: str, robot: str) -> str:
    if robot not in _WITH_A_WORLD:
        raise UsageError(
            f"--scorer {scorer} needs the simulator, and --robot is {robot}; choose --robot sim, "
            "or another scorer"
        )
    shipped = _scorer_tables()
    if not table or not shipped:  # without the detector here, another machine checks the table
        return f"{_SIMULATED}:{table}" if table else _SIMULATED
    if table not in shipped and Path(table).is_file():
        return f"{_SIMULATED}:{table}"
    known = same_name(table, shipped)
    if known is None:
        near = nearest(table, shipped)
        hint = f"; did you mean {near}?" if near else ""
        raise UsageError(
            f"--scorer {scorer}: no table of the simulated scorer is called {table!r}; wanted "
            f"{', '.join(shipped)}, or a TOML file{hint}"
        )
    return f"{_SIMULATED}:{known}"


def _scorer_tables() -> list[str]:
    """Names of the shipped tables; empty if the detector is not installed. Imports nothing."""
    spec = find_spec("helios_detector")
    folders = (spec.submodule_search_locations or ()) if spec else ()
    tables = (file for folder in folders for file in Path(folder, "scorer_tables").glob("*.toml"))
    return sorted(file.stem for file in tables)


def _check_model(file: str) -> None:
    path = onnx_file(file)
    if not file:
        raise UsageError("--detector onnx: names no file; wanted onnx:FILE, a YOLOX model")
    if path.is_dir():
        raise UsageError(f"--detector onnx:{file}: that is a folder; name the model file in it")
    if not path.is_file() and known(file):
        raise Unavailable(missing_sentence(file))
    if not path.is_file():
        near = nearest(path.name, (p.name for p in _beside(path)))
        hint = f"did you mean {near}?" if near else "name an existing file"
        raise UsageError(f"--detector onnx:{file}: there is no such file; {hint}")


def _beside(path: Path) -> list[Path]:
    try:
        return [p for p in path.parent.iterdir() if p.suffix == ".onnx"]
    except OSError:
        return []


def _check(kind: plugins.Kind, given: str, ours: tuple[str, ...], more: str) -> str:
    """Name as the services spell it: one of `ours`, or of an installed package. Raises
    UsageError."""
    offered = (*ours, *kind.entry_names())
    if (name := same_name(given, offered)) in ours:
        return name
    if ":" not in given and name is None:
        raise UsageError(_none_called(kind.name, given, offered, more))
    given = name or given
    try:
        plugins.check_there(kind, given)
    except InvalidInput as error:
        near = nearest(given.partition(":")[0], offered)
        hint = f"; did you mean {near}?" if near else ""
        raise UsageError(error.message + hint) from error
    return given


def _none_called(what: str, given: str, known: tuple[str, ...], more: str) -> str:
    near = nearest(given, known)
    hint = f"; did you mean {near}?" if near else ""
    package = "" if what == "preset" else f"{more}or package:attribute of your own"
    listed = ", ".join(known) + (f", {package}" if package else "")
    return f"no {what} is called {given!r}; wanted {listed}{hint}"
