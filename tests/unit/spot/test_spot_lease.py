"""Tests the lease between the driver, an operator at the tablet, and the SDK's late thread.

There is no robot server and no time: the test decides when a lease check is sent and when its
answer arrives, so that every order of events can occur.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from helios_core.errors import Conflict
from helios_spot import bosdyn_api
from helios_spot.halt_conditions import Halted
from helios_spot.motion import CannotDo
from hypothesis import settings as how
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from tests.unit.spot.lease_scene import TABLET, US, KeepAlive, Robot, Scene


@pytest.fixture(autouse=True)
def no_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bosdyn_api.lease, "LeaseKeepAlive", KeepAlive)


@pytest.fixture
def scene() -> Scene:
    return Scene(Robot())


def lose_lease_to_tablet(scene: Scene) -> KeepAlive:
    """An operator takes the lease and an action reports the loss. A failed check of the lease is
    still in progress; returns its keep-alive."""
    scene.act()
    check = scene.robot.keep_alives[-1]
    scene.take_by_hand()
    check.ask()
    with pytest.raises(Conflict, match="the tablet has taken the robot's lease"):
        scene.act()
    assert "then clear the stop" in scene.halt.stopped
    return check


@pytest.mark.parametrize("heard", ["before the next action", "in it", "after it"])
def test_a_lease_check_that_failed_before_the_clear_does_not_stop_the_robot_afterwards(
    scene: Scene, heard: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    check = lose_lease_to_tablet(scene)
    if heard != "in it":  # shutdown does not wait for the thread
        monkeypatch.setattr(KeepAlive, "shutdown", lambda _: None)
    scene.release_by_hand()
    scene.control.clear()
    if heard == "before the next action":
        check.hear()
    scene.act()
    check.hear()
    scene.act()
    assert not scene.halt.stopped


def test_clearing_a_stop_is_refused_with_a_reason_while_the_tablet_holds_the_lease(
    scene: Scene,
) -> None:
    lose_lease_to_tablet(scene)
    reported = scene.halt.stopped
    for _ in range(2):
        with pytest.raises(Conflict, match="cannot clear the stop: the tablet holds") as refused:
            scene.control.clear()
        assert "have it released there" in refused.value.message
        assert scene.halt.stopped == reported
    scene.release_by_hand()
    scene.control.clear()
    scene.act()


def test_clearing_a_stop_is_refused_while_an_e_stop_is_pressed(scene: Scene) -> None:
    lose_lease_to_tablet(scene)
    scene.release_by_hand()
    scene.robot.estops = ("hardware button",)
    with pytest.raises(Conflict, match="cannot clear the stop: hardware button is pressed"):
        scene.control.clear()
    assert scene.halt.stopped
    scene.robot.estops = ()
    scene.control.clear()
    scene.act()


def test_the_stop_stays_until_a_person_switches_the_motors_on(scene: Scene) -> None:
    scene.robot.settings.power, scene.robot.motors_on = "expect", True
    scene.act()
    scene.robot.motors_on = False
    with pytest.raises(Conflict, match="the motors were switched off"):
        scene.act()
    with pytest.raises(Conflict, match="switch them on at the tablet"):
        scene.control.clear()
    assert scene.halt.stopped
    scene.robot.motors_on = True
    scene.control.clear()
    scene.act()


def test_clearing_another_stop_also_recovers_a_lease_lost_unnoticed(scene: Scene) -> None:
    """The driver does not know of the loss when stop-now is cleared; the check arrives later."""
    scene.act()
    check = scene.robot.keep_alives[-1]
    scene.halt.stop("stop now")
    scene.take_by_hand()
    with pytest.raises(Conflict, match="the tablet holds"):
        scene.control.clear()
    check.ask()
    scene.release_by_hand()
    scene.control.clear()
    check.hear()
    assert not scene.halt.stopped
    scene.act()


def test_a_lease_that_is_taken_again_stops_the_robot_again(scene: Scene) -> None:
    lose_lease_to_tablet(scene)
    scene.release_by_hand()
    scene.control.clear()
    scene.take_by_hand()
    check = scene.robot.keep_alives[-1]
    check.ask()
    check.hear()
    assert "the tablet has taken the robot's lease" in scene.halt.stopped
    with pytest.raises(Conflict, match="clear the stop"):
        scene.act()
    assert [k.ended for k in scene.robot.keep_alives] == [True, False]  # one thread per lease


def test_a_lease_lost_during_an_action_ends_the_action_before_it_moves(scene: Scene) -> None:
    scene.act()
    scene.halt.begin()
    scene.take_by_hand()
    check = scene.robot.keep_alives[-1]
    check.ask()
    check.hear()
    with pytest.raises(Halted, match="the tablet has taken") as ended:
        scene.control.take(scene.robot.read())
    assert isinstance(ended.value.error, Conflict)


def test_an_e_stop_during_standing_up_keeps_the_motors_off_until_the_stop_is_cleared(
    scene: Scene,
) -> None:
    scene.pressed_while_it_gets_up = True
    with pytest.raises(CannotDo):
        scene.act()
    scene.robot.estops = ()
    for reported in ("the motors were switched off", "clear the stop"):
        with pytest.raises(Conflict, match=reported):
            scene.act()
    assert scene.robot.switched_on == 1
    scene.control.clear()
    scene.act()
    assert scene.robot.switched_on == 2


def test_a_stop_while_the_lease_is_acquired_keeps_the_motors_off(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    get_lease = KeepAlive.__init__

    def slowly(*args: Any, **kwargs: Any) -> None:
        get_lease(*args, **kwargs)
        scene.halt.stop("a child in the way")

    monkeypatch.setattr(KeepAlive, "__init__", slowly)
    with pytest.raises(Conflict, match="a child in the way"):
        scene.act()
    assert scene.robot.switched_on == 0


@pytest.mark.parametrize("reported_at_connecting", ["", "boot-1"])
def test_clearing_a_stop_is_refused_after_a_reboot(
    scene: Scene, reported_at_connecting: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene.robot.epoch = reported_at_connecting
    lose_lease_to_tablet(scene)
    scene.release_by_hand()
    monkeypatch.setattr(KeepAlive, "lease_proto", SimpleNamespace(epoch="boot-2"))
    with pytest.raises(Conflict, match="cannot clear the stop: the robot has rebooted; restart"):
        scene.control.clear()
    assert scene.halt.stopped
    assert not scene.robot.owner  # the lease is returned at once


def test_a_robot_that_rebooted_before_the_first_action_does_not_move(scene: Scene) -> None:
    scene.robot.epoch = "boot-0"
    with pytest.raises(Conflict, match="has rebooted; restart the bridge"):
        scene.act()
    assert scene.robot.switched_on == 0
    assert not scene.robot.owner


class AnyOrder(RuleBasedStateMachine):
    """Any order of an operator's interventions, the SDK's checks, actions and clears."""

    def __init__(self) -> None:
        super().__init__()
        self.scene = Scene(Robot())
        self.stepped_in_since_clear = False
        self.switched_on_before = 0  # power-on calls until the last clear
        self.on_under = 0  # the lease under which the motors were last on for an action

    @rule()
    def somebody_takes_it(self) -> None:
        self.stepped_in_since_clear = True
        self.scene.take_by_hand()

    @precondition(lambda self: self.scene.robot.owner == TABLET)
    @rule()
    def somebody_releases_it(self) -> None:
        self.scene.release_by_hand()

    @rule()
    def somebody_presses_an_e_stop(self) -> None:
        self.stepped_in_since_clear = True
        self.scene.robot.press_estop()

    @rule()
    def somebody_presses_an_e_stop_when_it_gets_up(self) -> None:
        self.scene.pressed_while_it_gets_up = True

    @rule()
    def somebody_releases_the_e_stop(self) -> None:
        self.scene.robot.estops = ()

    @precondition(lambda self: self.scene.robot.keep_alives)
    @rule()
    def the_lease_is_checked(self) -> None:
        self.scene.robot.keep_alives[-1].ask()

    @rule()
    def news_arrives(self) -> None:
        for check in self.scene.robot.keep_alives:
            check.hear()

    @rule()
    def a_person_clears_the_stop(self) -> None:
        reported = ""
        try:
            self.scene.control.clear()
        except Conflict as error:
            reported = error.message
        if self.scene.robot.estops and reported:
            assert "cannot clear the stop: hardware button is pressed; release it" in reported
        elif reported:
            assert self.scene.robot.owner == TABLET
            assert "the tablet holds the robot's lease; have it released there" in reported
        else:
            self.stepped_in_since_clear = bool(self.scene.robot.estops) or self.motors_were_cut
            self.switched_on_before = self.scene.robot.switched_on
        assert bool(reported) == bool(self.scene.halt.stopped)

    @rule()
    def it_acts(self) -> None:
        held, stopped = self.scene.control.held, self.scene.halt.stopped
        ours, pressed = self.scene.robot.owner == US, bool(self.scene.robot.estops)
        cut = self.motors_were_cut
        try:
            self.scene.act()
        except CannotDo:
            self.stepped_in_since_clear = True
            self.on_under = len(self.scene.robot.keep_alives)
        except Conflict:
            assert stopped or pressed or cut or not ours
            # A loss during an action is latched; a pressed e-stop is reported before an action.
            assert self.scene.halt.stopped or pressed or not held
        else:
            assert not any((stopped, pressed, cut))
            self.on_under = len(self.scene.robot.keep_alives)

    @property
    def motors_were_cut(self) -> bool:
        """Whether the motors were cut under the lease that the driver assumes to hold."""
        ours = self.scene.control.held and self.on_under == len(self.scene.robot.keep_alives)
        return ours and not self.scene.robot.motors_on

    @invariant()
    def only_who_stepped_in_after_the_last_clear_stops_it(self) -> None:
        assert not self.scene.halt.stopped or self.stepped_in_since_clear

    @invariant()
    def the_motors_come_on_once_for_each_clear(self) -> None:
        assert self.scene.robot.switched_on - self.switched_on_before <= 1


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = how(max_examples=200, stateful_step_count=30, deadline=None)
