"""Write the types of the driver interface into docs/reference/driver-types.md.

`--check` exits 1 if they are stale. Names, types and defaults come from the dataclasses; a field
without an entry in `MEANING` is an error.
"""

from __future__ import annotations

import dataclasses
import math

from helios_core.geometry import Pinhole
from helios_core.robot import (
    ActionResult,
    Capture,
    Forward,
    Observe,
    Pick,
    Place,
    Show,
    Tilt,
    Turn,
)
from helios_core.types import RobotDescription, RobotState

from scripts.markdown_tables import DOCS, Block

ACTIONS: tuple[type, ...] = (Forward, Turn, Tilt, Pick, Place, Observe, Show)
UNITS = {"_m": "m", "_rad": "rad", "_ns": "ns"}  # by the suffix of a name
SHOWN = {  # types as the page shows them
    "NDArray[np.uint8]": "array `[h, w, 3]`, uint8",
    "NDArray[np.float32]": "array `[h, w]`, float32",
    "Matrix": "array `[4, 4]`, float64",
    "pb.Frame | None": "`pb.Frame` or None",
}
MORE_UNITS = {
    "T_world_cam": "m",
    "T_world_base": "m",
    "fx": "px",
    "fy": "px",
    "cx": "px",
    "cy": "px",
    "width": "px",
    "height": "px",
    "color": "0 to 255",
}

MEANING: dict[type, dict[str, str]] = {
    Forward: {"distance_m": "drive straight ahead; below 0 straight back, at most `max_back_m`"},
    Turn: {"angle_rad": "turn on the spot by this; positive is left"},
    Tilt: {"angle_rad": "point the camera to this tilt, absolute; positive looks down"},
    Pick: {
        "point_world_m": "grasp the thing at this point (x, y, z) of the world",
        "class_name": "what it is; `held` of the state afterwards",
    },
    Place: {"point_world_m": "release the held thing above this point (x, y, z) of the world"},
    Observe: {},
    Show: {
        "angle_rad": "hold the held thing at `show_base_m`, turned by this about the vertical from "
        "how it was carried; positive is left. It stays there until the next drive, turn or place"
    },
    ActionResult: {
        "succeeded": "whether all of it was done",
        "reason": "one sentence when it was not",
        "moved_m": "how far the base moved, measured",
        "turned_rad": "by how much the base turned, measured; positive is left",
        "collided": "whether the robot touched something",
        "steps": "the robot's own count of steps since it started; for the records",
    },
    RobotDescription: {
        "name": "shown to people",
        "footprint_radius_m": "of the disc around the base's centre that holds the whole body",
        "height_m": "of the body above the floor; for people",
        "camera": "intrinsics of the camera, see `Pinhole`",
        "camera_height_m": "of the camera above the floor",
        "reach_m": "of the arm, level, from the base's centre to the thing's; 0 without an arm",
        "max_depth_m": "depth beyond it is not used",
        "camera_forward_m": "how far the camera is ahead of the base's centre",
        "min_forward_m": "shortest drive that makes sense",
        "max_forward_m": "longest drive in one action",
        "max_back_m": "longest drive straight back; 0: it cannot",
        "min_turn_rad": "smallest turn that makes sense",
        "max_turn_rad": "largest turn in one action",
        "tilt_range_rad": "least and largest tilt; positive looks down; equal: the camera is fixed",
        "can_move": "False: a carried camera",
        "can_pick": "whether `act` does `Pick`",
        "can_place": "whether `act` does `Place`",
        "simulated": "whether the world is a simulation, which has the truth to compare with",
        "recorded": "whether it plays what a robot did; leave it",
        "footprint_box_m": "length and width of a body that is no disc; None: a disc",
        "show_base_m": "where `Show` holds the thing's centre, (x, y, z) from the base; None: it "
        "cannot show what it holds",
        "world_frame": "frame of the poses in the robot's own messages, as ROS names it; empty: it "
        "has none",
    },
    RobotState: {
        "T_world_base": "pose of the base: on the floor, x ahead, z up",
        "tilt_rad": "of the camera; positive looks down",
        "held": "class name of the thing in the hand; empty: nothing",
        "moving": "set by the bridge; leave it",
        "stopped": "whether `stop` holds",
        "world_epoch": "raise it by 1 when localisation jumps, so that the maps begin anew",
        "robot_boot_id": "another text at each start of the robot; empty: the bridge gives one",
        "message": "one sentence for people, for example the reason of a stop",
        "finished": "set by the bridge; leave it",
        "last_seq": "set by the bridge; leave it",
        "last_action_id": "set by the bridge; leave it",
        "origin_id": "names the origin of the poses: the same text at two starts says that they "
        "mean the same places, and the maps go on; empty: not known",
        "battery": "charge, 0 to 1; None: not known",
    },
    Capture: {
        "stamp_ns": "when the image was taken, on the robot's clock",
        "color": "RGB, not BGR",
        "depth_m": "along the optical axis, registered to `color`; 0 where there is none",
        "camera": "intrinsics of this image",
        "T_world_cam": "pose of the camera **then**; OpenCV axes: x right, y down, z forward",
        "T_world_base": "pose of the base **then**",
        "recorded": "of a replay; leave it",
        "searching": "of a replay; leave it",
    },
    Pinhole: {
        "fx": "focal length along the image's width",
        "fy": "focal length along its height",
        "cx": "column of the principal point",
        "cy": "row of the principal point",
        "width": "of the image",
        "height": "of the image",
    },
}


def section() -> str:
    """Text of the generated block."""
    actions = [
        f"| `{kind.__name__}` {row}"
        for kind in ACTIONS
        for row in (_rows(kind) or ["| | | | | do nothing but look |"])
    ]
    head = "field | type | unit | default | meaning |\n|---|---|---|---|---|"
    out = [
        "The actions that `act` gets (`helios_core.robot`); no field has a default:\n",
        "| action | field | type | unit | default | meaning |\n|---|---|---|---|---|---|",
        *actions,
    ]
    for kind, words in (
        (ActionResult, "What `act` returns, an `ActionResult` (`helios_core.robot`):"),
        (RobotDescription, "What `describe` returns, a `RobotDescription` (`helios_core.types`):"),
        (RobotState, "What `state` returns, a `RobotState` (`helios_core.types`):"),
        (Capture, "What `capture` returns, a `Capture` (`helios_core.robot`):"),
        (Pinhole, "The intrinsics in both, a `Pinhole` (`helios_core.geometry`):"),
    ):
        out += [f"\n{words}\n", f"| {head}", *_rows(kind)]
    return "\n".join(out) + "\n"


def _rows(kind: type) -> list[str]:
    """One table row per field, in the order of the constructor. Raises KeyError for a field without
    a meaning, and for a meaning without a field."""
    meanings = dict(MEANING[kind])
    rows = []
    for f in dataclasses.fields(kind):
        shown = SHOWN.get(str(f.type), f"`{f.type}`".replace(" | ", "` or `"))
        unit = MORE_UNITS.get(f.name) or next(
            (unit for end, unit in UNITS.items() if f.name.endswith(end)), ""
        )
        rows.append(f"| `{f.name}` | {shown} | {unit} | {_default(f)} | {meanings.pop(f.name)} |")
    if meanings:
        raise KeyError(f"{kind.__name__} has no field {', '.join(meanings)}")
    return rows


def _default(f: dataclasses.Field) -> str:
    if f.default is dataclasses.MISSING:
        return "required"
    if isinstance(f.default, float) and f.name.endswith("_rad"):
        return f"{f.default:.4g} ({math.degrees(f.default):.0f}°)" if f.default else "0"
    return f"`{f.default!r}`"


PAGE = DOCS / "reference/driver-types.md"
BLOCK = Block(PAGE, "types", "python -m scripts.page_of_types", section)

if __name__ == "__main__":
    BLOCK.main()
