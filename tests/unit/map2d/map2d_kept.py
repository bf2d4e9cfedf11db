"""Helpers that build, save, load and compare 2D maps."""

from __future__ import annotations

import numpy as np
from helios_core import proto as pb
from helios_core.topics import LOAD_MAP2D, SAVE_MAP2D
from helios_core.types import WorldId
from helios_map2d.epoch_map import EpochMap
from helios_map2d.epochs import EpochMaps
from map2d_rig import Rig


def state_of(rig: Rig) -> EpochMap:
    maps = rig.service._maps
    assert maps is not None
    assert maps.current is not None
    return maps.current


def parked(maps: EpochMaps) -> dict[WorldId, EpochMap]:
    """The maps of earlier world epochs, oldest first."""
    return maps._parked.by_world()


def saved(rig: Rig, kind: str) -> list[pb.Map2DFile]:
    return list(rig.bus.call(SAVE_MAP2D, pb.SaveMap2DRequest(format=kind), 10).files)


def load(rig: Rig, files: list[pb.Map2DFile], same_frame: bool = True) -> pb.LoadMap2DReply:
    return rig.bus.call(LOAD_MAP2D, pb.LoadMap2DRequest(files=files, same_frame=same_frame), 10)


def walked(*flags: str) -> Rig:
    """A rig whose robot has looked around, with a view memory that can be searched later."""
    rig = Rig(*flags)
    rig.say_epoch("boot")
    rig.search("first")
    for frame in rig.walk.look_around(2.0, 1.5):
        rig.keyframe(frame)
        rig.observe(frame, "first", {"pick": 0.3, "place": 0.6})
    return rig


def assert_same_state(one: EpochMap, other: EpochMap) -> None:
    a, b = one.published, other.published
    assert a.grid == b.grid
    for name in ("occupancy", "explored_for_search", "z_low_m", "z_high_m"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    for name, value in a.values.items():
        np.testing.assert_array_equal(value, b.values[name])
        np.testing.assert_array_equal(a.confidences[name], b.confidences[name])
    assert [(f.id, f.centre_m, f.size_m, f.reachable, f.values) for f in a.frontiers] == [
        (f.id, f.centre_m, f.size_m, f.reachable, f.values) for f in b.frontiers
    ]
    np.testing.assert_array_equal(a.trajectory_m, b.trajectory_m)
    assert len(one.memory) == len(other.memory)
