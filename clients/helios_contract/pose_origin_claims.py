"""Contract tests of the origin of the robot's poses across restarts."""

from __future__ import annotations

import pytest
from helios_core.robot import Observe

from helios_contract.rig import Rig

LONGEST_NAME = 64
UNNAMED = "this driver names no origin: maps begin anew at each of its starts"


class PoseOriginClaims:
    """Contract tests of `RobotState.origin_id`."""

    def test_the_name_of_the_origin_is_short_enough_to_be_shown(self, rig: Rig) -> None:
        assert len(rig.driver.state().origin_id) <= LONGEST_NAME

    def test_the_origin_stays_the_same_while_the_robot_acts(self, rig: Rig) -> None:
        before = rig.driver.state()
        rig.act(Observe())
        after = rig.driver.state()
        assert before.origin_id == after.origin_id or before.world_epoch < after.world_epoch

    def test_a_driver_that_names_an_origin_names_the_same_one_at_every_start(
        self, rig: Rig
    ) -> None:
        origin_id = rig.driver.state().origin_id
        if not origin_id:
            pytest.skip(UNNAMED)
        if rig.started_again is None:
            pytest.skip("the driver is started once here; --start-twice makes a second one")
        with rig.started_again() as another:
            assert another.state().origin_id == origin_id
