"""What the flags of `helios up` and `helios replay` name, looked at before anything is started.

No model is loaded and nothing of a plug-in is run: that does the service, which says the rest.
"""

from __future__ import annotations

from pathlib import Path

from helios_core import plugins
from helios_core.agent_settings import AGENT_NAMES
from helios_core.errors import HeliosError, InvalidInput
from helios_core.settings_names import nearest

from helios_client.supervision.stack import RECORDED
from helios_client.wrong_use import WrongUse

ROBOTS = ("sim", "replay", "spot", "bus", "push")
_DETECTORS = ("simulated", "ground-truth", RECORDED)
_SCORERS = ("lexical", "minilm")
FURNITURE = ("parametric", "realistic")
DEFAULT_PRESET = "demo-v1"


def check_robot(robot: str) -> None:
    """Raises WrongUse."""
    _check(plugins.ROBOTS, robot, ROBOTS, "")


def check_detector(detector: str) -> None:
    """Whether there can be such a detector, and where it is a file, whether that is there.

    Raises WrongUse.
    """
    kind, _, model = detector.partition(":")
    if kind == "onnx":
        _check_model(model)
    elif not (kind == "transformers" and model):
        _check(plugins.DETECTORS, detector, _DETECTORS, "onnx:FILE, transformers:ID, ")


def check_scorer(scorer: str) -> None:
    """Raises WrongUse."""
    kind, _, model = scorer.partition(":")
    if not (kind == "transformers" and model):
        _check(plugins.SCORERS, scorer, _SCORERS, "transformers:ID, ")


def check_agent(agent: str) -> None:
    """Raises WrongUse."""
    _check(plugins.AGENTS, agent, AGENT_NAMES, "")


def check_home(robot: str, preset: str, furniture: str | None) -> None:
    """Whether the simulator has such homes; realistic furniture must have been baked.

    Raises WrongUse.
    """
    if furniture not in (None, *FURNITURE):
        raise WrongUse(f"no furniture is called {furniture!r}; wanted {' or '.join(FURNITURE)}")
    if robot != "sim":
        return
    if preset != DEFAULT_PRESET:
        from helios_sim.home.presets import PRESETS  # late: the simulator takes half a second

        if preset not in PRESETS:
            raise WrongUse(_none_called("preset", preset, tuple(PRESETS), ""))
    if furniture == "realistic":
        from helios_sim.assets import pack

        try:
            pack.read_index(pack.default_cache() / "current")
        except HeliosError as error:
            raise WrongUse(f"--furniture realistic: {error.message}") from error


def _check_model(file: str) -> None:
    path = Path(file)
    if not file:
        raise WrongUse("--detector onnx: names no file; wanted onnx:FILE, a YOLOX model")
    if path.is_dir():
        raise WrongUse(f"--detector onnx:{file}: that is a folder; name the model file in it")
    if not path.is_file():
        near = nearest(path.name, (p.name for p in _beside(path)))
        hint = f"did you mean {near}?" if near else "name a file that is there"
        raise WrongUse(f"--detector onnx:{file}: there is no such file; {hint}")


def _beside(path: Path) -> list[Path]:
    try:
        return [p for p in path.parent.iterdir() if p.suffix == ".onnx"]
    except OSError:
        return []


def _check(kind: plugins.Kind, given: str, ours: tuple[str, ...], more: str) -> None:
    """Whether it is one of ours, or of a package that is there. Raises WrongUse."""
    if given in ours:
        return
    offered = (*ours, *kind.entry_names())
    if ":" not in given and given not in kind.entry_names():
        raise WrongUse(_none_called(kind.name, given, offered, more))
    try:
        plugins.check_there(kind, given)
    except InvalidInput as error:
        near = nearest(given.partition(":")[0], offered)
        hint = f"; did you mean {near}?" if near else ""
        raise WrongUse(error.message + hint) from error


def _none_called(what: str, given: str, known: tuple[str, ...], more: str) -> str:
    near = nearest(given, known)
    hint = f"; did you mean {near}?" if near else ""
    package = "" if what == "preset" else f"{more}or package:attribute of your own"
    listed = ", ".join(known) + (f", {package}" if package else "")
    return f"no {what} is called {given!r}; wanted {listed}{hint}"
