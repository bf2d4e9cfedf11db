"""Search context of an instruction: the classes, thresholds and prompts that all services use."""

from __future__ import annotations

from dataclasses import replace

from helios_core import proto as pb
from helios_core.errors import InvalidInput
from helios_core.household_names import HOUSEHOLD_NAMES
from helios_core.name_rules import closest, plain
from helios_core.types import Role, SearchClass, SearchContext

from helios_planner.instruction.lexicon import BINDING
from helios_planner.instruction.parser import Instruction, Kind
from helios_planner.search.base import PICK_LAYER, PLACE_LAYER
from helios_planner.settings import Settings

ALL_NAMES = "all that it knows: `helios names` (HTTP: GET /v1/vocabulary)"


def search_context(id: str, instruction: Instruction, settings: Settings) -> SearchContext:
    """Classes with their thresholds, and the prompts of the value layers and of the classes. The
    pick layer's prompt names the start receptacle if there is one (section 3.1.2), else the
    object."""
    wanted = (
        (instruction.object, Role.OBJECT, settings.od_g),
        (instruction.start, Role.START_RECEPTACLE, settings.od_a),
        (instruction.goal, Role.GOAL_RECEPTACLE, settings.od_b),
    )
    classes = tuple(SearchClass(name, role, threshold) for name, role, threshold in wanted if name)
    prompts = {}
    if pick := instruction.start or instruction.object:
        prompts[PICK_LAYER] = settings.prompt.format(pick)
    if instruction.goal:
        prompts[PLACE_LAYER] = settings.prompt.format(instruction.goal)
    also = HOUSEHOLD_NAMES if settings.ask_also == "household" else ()
    of_classes = {c.name: settings.prompt.format(c.name) for c in classes}
    return SearchContext(id, classes, prompts, also, of_classes)


def in_vocabulary(instruction: Instruction, vocabulary: pb.VocabularyReply) -> Instruction:
    """The instruction in the detector's names: the name itself, its singular, or the known name
    that it ends with ("red coffee mug" is a mug, "bowl of oranges" a bowl); other words count as
    unused. Raises InvalidInput for an unknown name, and for an object with the same name as a
    place."""
    if vocabulary.open:
        return instruction
    known = {plain(name): name for name in vocabulary.names}
    named: dict[str, str] = {}
    unused: list[str] = []
    for role in ("object", "start", "goal"):
        if said := getattr(instruction, role):
            named[role], rest = _known(role, said, known, vocabulary.detector)
            unused += rest
    for role in ("start", "goal"):
        if role in named and named[role] == named.get("object"):
            raise InvalidInput(
                f"the detector ({vocabulary.detector}) knows the object “{instruction.object}” and "
                f"the place “{getattr(instruction, role)}” only as “{named[role]}”, so it cannot "
                f"tell them apart; name another place, of {ALL_NAMES}"
            )
    return replace(instruction, unused=(*instruction.unused, *unused), **named)


def check_able(instruction: Instruction, robot: pb.RobotDescription) -> None:
    """Raises InvalidInput for a task that this robot can never do."""
    if not robot.can_move:
        raise InvalidInput(
            f"the robot {robot.name!r} cannot move (it plays a recording, or is fixed), so it can "
            "do no task; start one that can, for example `helios up --robot sim`"
        )
    if not robot.max_turn_rad > 0:
        raise InvalidInput(
            f"the robot {robot.name!r} cannot turn (max_turn_rad is {robot.max_turn_rad:g}), so it "
            "can do no task; give max_turn_rad in its driver's describe()"
        )
    if instruction.kind is Kind.MOVE and not (robot.can_pick and robot.can_place):
        raise InvalidInput(
            f"the robot {robot.name!r} has no arm, so it cannot move the {instruction.object}; "
            f"ask it to find it: “find the {instruction.object}”"
        )


def _known(role: str, name: str, known: dict[str, str], detector: str) -> tuple[str, list[str]]:
    """The detector's name, and the unused words. The part after "of" may be unused; words that
    negate the name or add another ("anything but the mug") may not."""
    head, of, rest = name.partition(" of ")
    for said, beside in ((name, []), (head, [f"of {rest}"] if of else [])):
        words = plain(said).split()
        for k in range(len(words)):
            tail = " ".join(words[k:])
            for form in (tail, tail.removesuffix("s"), tail.removesuffix("es")):
                if form in known and not BINDING & set(words[:k]):
                    return known[form], [*([" ".join(words[:k])] if k else []), *beside]
    near = closest(name, list(known))
    hint = f"did you mean {' or '.join(near)}? ({ALL_NAMES})" if near else ALL_NAMES
    raise InvalidInput(f"the detector ({detector}) does not know the {role} “{name}”; {hint}")
