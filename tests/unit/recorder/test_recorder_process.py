"""The recorder as a process over a router: it requests the maps and records the answers."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helios_core import proto as pb
from helios_core.errors import Unavailable
from helios_core.map_snapshot import OCCUPIED
from helios_core.topics import status_topic
from helios_core.zenoh_bus import ZenohBus

from tests.support import ENDS_WITHIN_S, free_port, wait_until
from tests.unit.recorder.recorder_maps import FakeMaps, cells_of, last_of, snapshot_of
from tests.unit.recorder.test_recorder_file import messages, only_file


@pytest.fixture
def router() -> Iterator[str]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    process = subprocess.Popen([sys.executable, "-m", "helios_core.router", "--listen", endpoint])
    yield endpoint
    process.terminate()
    process.wait(ENDS_WITHIN_S)


def test_a_recorder_process_records_each_version_of_the_running_maps_once(
    router: str, tmp_path: Path
) -> None:
    """Started while the robot stands still, the recorder requests them once; then after changes."""
    opened: list[ZenohBus] = []

    def connected() -> bool:
        try:
            opened.append(ZenohBus(router))
        except Unavailable:
            return False
        return True

    wait_until(connected, 60, "the router is up")
    (bus,) = opened
    occupancy = np.zeros((300, 400), np.int8)
    occupancy[7, 11] = OCCUPIED
    maps = FakeMaps(bus, snapshot_of(occupancy, values={"pick": np.ones((300, 400), np.float32)}))
    states: list[pb.ServiceStatus] = []
    bus.subscribe(status_topic("recorder"), states.append)
    flags = ("--out", str(tmp_path), "--min-free-mb", "0", "--map-period-s", "0.05")
    recorder = subprocess.Popen(
        [sys.executable, "-m", "helios_recorder", "--router", router, *flags]
    )
    try:
        wait_until(lambda: maps.asked, 60, "it asks by itself")
        wait_until(lambda: states and states[-1].state == "ready", 60, "it records")
        changed = occupancy.copy()
        changed[8, 11] = OCCUPIED

        def asked_again() -> bool:  # acks arrive once the router knows the recorder
            maps.announce()
            return maps.asked > 3

        wait_until(asked_again, 60, "it hears that there is something new")
        maps.change(snapshot_of(changed))

        def is_kept() -> bool:
            grid = last_of(tmp_path).get("/map/occupancy")
            return grid is not None and bool(cells_of(grid)["occupancy"][8, 11] == OCCUPIED)

        wait_until(is_kept, 60, "the change is in the file")
    finally:
        recorder.terminate()
        assert recorder.wait(ENDS_WITHIN_S) == 0
        bus.close()
    said = messages(only_file(tmp_path))
    grids = [cells_of(grid)["occupancy"] for grid in said["/map/occupancy"]]
    np.testing.assert_array_equal(grids[0], occupancy)
    np.testing.assert_array_equal(grids[-1], changed)
    assert len(grids) == 2  # an unchanged map is not recorded again
    wiped = cells_of(said["/map/value/pick"][-1])
    assert wiped.shape == (1, 1)  # the layer is gone
    assert states[-1].metrics["missed_maps"] == 0
