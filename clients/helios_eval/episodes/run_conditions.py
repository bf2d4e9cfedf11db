"""Conditions of a run as given on the command line, checked before any episode is played."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import get_args

from helios_client.usage_errors import UsageError
from helios_core.errors import InvalidInput
from helios_core.name_rules import same_name
from helios_core.plugins import SCORERS, check_there, find
from helios_detector.model_loading import open_scorer
from helios_detector.simulation.view_scorer import DEFAULT_TABLE, load_scorer_table
from helios_objectmap import error_model
from helios_sim.manipulation import PICK_RULES
from helios_sim.sensor_noise import SENSORS

from helios_eval.episodes import episode_spec, home_presets, service_settings
from helios_eval.episodes.episode_record import Benchmark, Noise, Semantics, Setting
from helios_eval.episodes.episode_spec import EpisodeInputs
from helios_eval.episodes.plan_homes import PlanHomes, plan_homes
from helios_eval.episodes.real_detector import real_detector
from helios_eval.episodes.task_classes import task_classes_for

ERROR_MODEL = "objectmap.error_model"  # setting that names a file, as SCORER may
_DIGITS = 16  # hex digits of a digest


@dataclass(frozen=True)
class Condition:
    """Conditions of all episodes of a command. `settings` are the given ones, for every agent."""

    agents: tuple[str, ...]
    benchmark: Benchmark
    semantics: Semantics
    preset: str
    noise: Noise | None
    settings: dict[str, Setting]
    inputs: EpisodeInputs = field(default_factory=EpisodeInputs)


def parse_condition(
    agents: list[str],
    benchmark: str,
    *,
    semantics: str,
    preset: str,
    table: str | None,
    level: float,
    correlation: float | None,
    sensor: str,
    assignments: Iterable[str],
    max_steps: int | None,
    scorer: str | None,
    pick_rule: str = episode_spec.DEFAULT_PICK_RULE,
    absent: float = 0.0,
    detector: str | None = None,
    task_classes: str | None = None,
    homes: Path | None = None,
    home_level: str = "",
) -> Condition:
    """Condition from the flags of `helios eval`. table None: the preset's; scorer None: the one
    that `assignments` name, else the evaluation's default; pick_rule: one of PICK_RULES, in any
    letter case; absent: share of the homes whose task asks for an absent object, 0 to 1; detector:
    the real one of semantics "detector"; task_classes: see `task_classes_for`; homes: plan file or
    folder instead of a preset, home_level: the level in it. Raises UsageError, also if the scorer
    or the error model cannot be used."""
    known_benchmark = next((b for b in get_args(Benchmark) if b == benchmark), None)
    said = same_name(semantics, get_args(Semantics))
    known_semantics = next((s for s in get_args(Semantics) if s == said), None)
    if known_benchmark is None:
        raise UsageError(f"--benchmark is {benchmark!r}; wanted ovmm or objectnav")
    known_agents = tuple(episode_spec.check_agents(agents, known_benchmark))
    plans = _plans(preset, homes, home_level)
    preset = plans.kind if plans is not None else home_presets.check_kind(preset)
    if known_semantics is None:
        raise UsageError(f"--semantics is {semantics!r}; wanted noisy, ground-truth or detector")
    if sensor not in SENSORS:
        raise UsageError(f"--sensor is {sensor!r}; wanted one of {', '.join(SENSORS)}")
    settings = service_settings.parsed(assignments)
    if known_semantics != "detector":
        _check_no_detector(known_semantics, settings)
    if max_steps is not None and max_steps != home_presets.default_steps(preset, known_benchmark):
        settings[episode_spec.MAX_STEPS] = max_steps
    if sensor != "none":
        settings[episode_spec.SENSOR] = sensor
    settings |= _of_tasks(known_benchmark, pick_rule, absent)
    inputs = _inputs(known_benchmark, known_semantics, preset, detector, task_classes, absent)
    inputs = replace(inputs, plans=plans)
    settings |= _named(inputs, settings)
    default_scorer = episode_spec.REAL_SCORER if inputs.detector else episode_spec.DEFAULT_SCORER
    if scorer is not None or episode_spec.SCORER not in settings:
        settings |= service_settings.parsed([f"{episode_spec.SCORER}={scorer or default_scorer}"])
    setting_files(known_agents, settings)
    noisy = known_semantics == "noisy"
    if not noisy:
        _check_no_noise(known_semantics, table, level, correlation)
    noise = _noise(table or home_presets.noise_of(preset), level, correlation) if noisy else None
    return Condition(
        known_agents, known_benchmark, known_semantics, preset, noise, settings, inputs
    )


def _check_no_noise(
    semantics: str, table: str | None, level: float, correlation: float | None
) -> None:
    """Raise UsageError for a flag of the simulated errors, which other semantics do not have."""
    flags = {
        "--noise": table is not None,
        "--noise-level": level != 1.0,
        "--noise-correlation": correlation is not None,
    }
    if given := [flag for flag, is_given in flags.items() if is_given]:
        raise UsageError(
            f"{given[0]} has no effect with --semantics {semantics}; leave it out, or take "
            "--semantics noisy"
        )


def _check_no_detector(semantics: str, settings: Mapping[str, Setting]) -> None:
    """Raise UsageError for a setting of the detector, which other semantics simulate."""
    of_detector = (name for name in settings if name.startswith("detector."))
    if given := [name for name in of_detector if name != episode_spec.SCORER]:
        raise UsageError(
            f"--set {given[0]} has no effect with --semantics {semantics}; leave it out, or take "
            "--semantics detector"
        )


def _noise(table: str, level: float, correlation: float | None) -> Noise:
    """Noise of the flags. Raises UsageError."""
    try:
        return episode_spec.noise_of(table, level, correlation)
    except InvalidInput as error:
        raise UsageError(error.message) from error


def setting_files(agents: Iterable[str], settings: Mapping[str, Setting]) -> dict[str, str]:
    """Digests of the files that the settings of these agents' stacks name: the table of a simulated
    scorer, and an error model. By "setting=value"; 16 hex digits.

    Raises UsageError for a file that cannot be used, and for an unknown scorer.
    """
    digests: dict[str, str] = {}
    for agent in agents:
        stack = service_settings.of_stack(agent, settings)
        for setting, digest_of in ((episode_spec.SCORER, _scorer), (ERROR_MODEL, _error_model)):
            value = str(stack.get(setting, ""))
            try:
                digest = digest_of(value) if value else ""
            except InvalidInput as error:
                raise UsageError(f"{setting} is {value!r}: {error.message}") from error
            if digest:
                digests[f"{setting}={value}"] = digest
    return digests


def setting_file_names(stack: Mapping[str, Setting]) -> list[str]:
    """Keys of `setting_files` that the settings of a stack can have."""
    return [f"{name}={stack[name]}" for name in (episode_spec.SCORER, ERROR_MODEL) if name in stack]


def _scorer(spec: str) -> str:
    """Digest of a simulated scorer's table; empty for another scorer, whose model is not opened.

    Raises InvalidInput for an unknown scorer and for a table that cannot be used.
    """
    kind, _, argument = spec.partition(":")
    if kind == "simulated":
        return load_scorer_table(argument or DEFAULT_TABLE)[1]
    if spec in ("lexical", "minilm") or (kind == "transformers" and argument):
        return ""
    if find(SCORERS, spec) is None:
        open_scorer(spec).close()  # raises InvalidInput that names the known scorers
    check_there(SCORERS, spec)
    return ""


def _error_model(name: str) -> str:
    """Digest of the file of an error model. Raises InvalidInput if it cannot be used."""
    error_model.opened(name)
    if name in error_model.shipped_models():
        file = resources.files(error_model.PACKAGE).joinpath("error_models", f"{name}.json")
    else:
        file = Path(name).expanduser()
    try:
        data = file.read_bytes()
    except OSError as error:
        raise InvalidInput(f"{name} cannot be read ({error}); give a file that is there") from error
    return hashlib.sha256(data).hexdigest()[:_DIGITS]


def _plans(preset: str, homes: Path | None, level: str) -> PlanHomes | None:
    """Plans that the flags name; None for homes of a preset. Raises UsageError."""
    if homes is None:
        if level:
            raise UsageError(f"--level {level} came without a plan; add --homes FILE.sh3d")
        return None
    if preset != home_presets.LIKE_PLANS:
        raise UsageError(
            f"--homes {homes} and --preset {preset} both name the homes; leave one of them out"
        )
    return plan_homes(homes, level)


def _inputs(
    benchmark: Benchmark,
    semantics: Semantics,
    preset: str,
    detector: str | None,
    task_classes: str | None,
    absent: float,
) -> EpisodeInputs:
    """Real detector and classes of the tasks that the flags name. Raises UsageError."""
    if detector is not None and semantics != "detector":
        raise UsageError(
            f"--detector {detector} came with --semantics {semantics}, which simulates its "
            "detections; add --semantics detector, or leave --detector out"
        )
    if semantics == "detector" and benchmark != "ovmm":
        raise UsageError(
            f"--semantics detector is for --benchmark ovmm; {benchmark} takes noisy or ground-truth"
        )
    if semantics == "detector" and detector is None:
        raise UsageError(
            "--semantics detector came without a detector; add --detector onnx:FILE or "
            "transformers:ID"
        )
    if task_classes is not None and benchmark != "ovmm":
        raise UsageError(
            f"--task-classes {task_classes} is for --benchmark ovmm, not for {benchmark}; leave it "
            "out"
        )
    real = real_detector(detector) if detector is not None else None
    classes = task_classes_for(task_classes, preset, real)
    if classes is not None and absent:
        raise UsageError(
            f"--absent {absent:g} came with tasks of the classes {classes.name}; give "
            "--task-classes all, or leave --absent out"
        )
    return EpisodeInputs(real, classes)


def _named(inputs: EpisodeInputs, others: Mapping[str, Setting]) -> dict[str, Setting]:
    """Settings of a record that name the content of the inputs. Raises UsageError if the others
    have a pick rule by the home's names, and tasks are in a detector's words."""
    if inputs.task_classes is not None and episode_spec.PICK_RULE in others:
        raise UsageError(
            f"--pick-rule {others[episode_spec.PICK_RULE]} knows the home's own names, and tasks "
            f"of the classes {inputs.task_classes.name} use the detector's; leave --pick-rule out"
        )
    settings: dict[str, Setting] = {}
    if inputs.detector is not None:
        settings[episode_spec.DETECTOR] = inputs.detector.name
    if inputs.task_classes is not None:
        settings[episode_spec.TASK_CLASSES] = inputs.task_classes.name
    return settings


def _of_tasks(benchmark: Benchmark, pick_rule: str, absent: float) -> dict[str, Setting]:
    """Settings of a record for the pick rule and absent objects, where they are not the default.

    Raises UsageError.
    """
    rule = same_name(pick_rule, PICK_RULES)
    if rule is None:
        raise UsageError(f"--pick-rule is {pick_rule!r}; wanted {' or '.join(PICK_RULES)}")
    if not 0 <= absent <= 1:
        raise UsageError(f"--absent is {absent:g}; wanted a share from 0 to 1")
    settings: dict[str, Setting] = {}
    if rule != episode_spec.DEFAULT_PICK_RULE:
        settings[episode_spec.PICK_RULE] = rule
    if absent:
        settings[episode_spec.ABSENT] = float(absent)
    if settings and benchmark != "ovmm":
        flags = ", ".join(f"--{name.replace('_', '-')} {value}" for name, value in settings.items())
        raise UsageError(f"{flags} is for --benchmark ovmm; {benchmark} moves no object")
    return settings
