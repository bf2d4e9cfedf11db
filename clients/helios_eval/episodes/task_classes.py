"""Classes that tasks may ask for: a TOML table of what a detector recognises in our images.

`python -m helios_eval.studies.realism --write-classes FILE` writes such a table; those in the
folder `recognised_classes` belong to this program and have their model's SHA-256.
"""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from helios_client.usage_errors import UsageError
from helios_sim.home import Episode

from helios_eval.episodes.real_detector import DIGITS, RealDetector

ALL = "all"
FOLDER = Path(__file__).with_name("recognised_classes")
PARAMETRIC, REALISTIC = "parametric", "realistic"
_HOW = "write one with: python -m helios_eval.studies.realism --write-classes FILE"


@dataclass(frozen=True)
class TaskClasses:
    """Classes that tasks may ask for."""

    name: str  # as records name it: the table's name, and a digest of the classes
    objects: dict[str, str]  # class in our homes -> the detector's word for it
    receptacles: dict[str, str]

    def words(self, episode: Episode) -> Episode:
        """The task with an instruction in the detector's words: it refuses others."""
        thing = self.objects[episode.object_class]
        start = self.receptacles[episode.start_receptacle_class]
        goal = self.receptacles[episode.goal_receptacle_class]
        return replace(episode, instruction=f"Move the {thing} from the {start} to the {goal}")

    def class_of(self, word: str) -> str:
        """Class in our homes that the detector's word stands for; any other word as it is."""
        both = (*self.objects.items(), *self.receptacles.items())
        return next((name for name, said in both if said == word), word)


def task_classes_for(
    given: str | None, preset: str, detector: RealDetector | None
) -> TaskClasses | None:
    """Classes of the tasks of a run; None: every class.

    given: `--task-classes`, a file, the name of a table of this program, or `all`. Without it a
    real detector has the table with its own SHA-256. Raises UsageError.
    """
    if given == ALL or (given is None and detector is None):
        return None
    path = _own_table(detector) if given is None and detector else _path_of(str(given))
    table = _read(path)
    of_model = str(table.get("sha256", ""))
    if detector is not None and detector.sha256 and of_model not in ("", detector.sha256):
        raise UsageError(
            f"{path} is of the model {of_model[:DIGITS]}, and --detector is {detector.name}; "
            f"{_HOW}, or give --task-classes {ALL}"
        )
    return _of_table(table, REALISTIC if "+" in preset else PARAMETRIC, path)


def _own_table(detector: RealDetector) -> Path:
    for path in sorted(FOLDER.glob("*.toml")):
        if detector.sha256 and _read(path).get("sha256") == detector.sha256:
            return path
    raise UsageError(
        f"no table says which classes {detector.name} recognises; {_HOW}, and give it with "
        f"--task-classes FILE, or give --task-classes {ALL} for tasks with every class"
    )


def _path_of(given: str) -> Path:
    named = FOLDER / f"{given}.toml"
    path = named if named.is_file() else Path(given)
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in FOLDER.glob("*.toml")))
        raise UsageError(f"--task-classes is {given!r}; wanted {ALL}, a TOML file, or {known}")
    return path


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} is no table of classes ({error}); {_HOW}") from error


def _of_table(table: Mapping[str, Any], looks: str, path: Path) -> TaskClasses:
    part = table.get(looks)
    if not isinstance(part, dict):
        raise UsageError(f"{path} has no part [{looks}], which these homes need; {_HOW}")
    found: list[Any] = [part.get(name) for name in ("objects", "receptacles")]
    if not all(isinstance(names, dict) and names for names in found):
        raise UsageError(
            f"{path}: wanted [{looks}.objects] and [{looks}.receptacles] with lines "
            'class = "the detector\'s word"'
        )
    objects, receptacles = ({str(k): str(v) for k, v in sorted(names.items())} for names in found)
    digest = hashlib.sha256(repr((objects, receptacles)).encode()).hexdigest()
    return TaskClasses(f"{path.stem}@{digest[:DIGITS]}", objects, receptacles)
