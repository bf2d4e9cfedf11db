"""The lease among three: us, a person at the tablet, and the SDK's thread, which hears late.

The robot is a name here, no server, and nothing takes time: a check of the lease is asked for and
heard of when a test says so, so that every order of what happens can be played.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest
from helios_core.errors import Conflict
from helios_spot import api
from helios_spot.control import Control
from helios_spot.errors import translate
from helios_spot.halt import Halt, Halted
from helios_spot.reading import Reading
from hypothesis import settings as how
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from tests.fake_spot import pb

TABLET = "the tablet"
US = "helios"


def not_ours(owner: str) -> Exception:
    """What using a lease raises that is not the robot's newest."""
    reply = pb.lease.RetainLeaseResponse()
    reply.lease_use_result.owner.client_name = owner
    return api.exceptions.LeaseUseError(reply, reply.lease_use_result)


def claimed(owner: str) -> Exception:
    """What asking for a lease raises that somebody has."""
    reply = pb.lease.AcquireLeaseResponse()
    reply.lease_owner.client_name = owner
    return api.lease.ResourceAlreadyClaimedError(reply)


class Robot:
    """Who may move it, as the SDK's client and our link show it. `number`: of the newest lease."""

    host = "spot"

    def __init__(self) -> None:
        self.owner, self.number = "", 0
        self.estops: tuple[str, ...] = ()
        self.motors_on = False
        self.settings: Any = SimpleNamespace(
            estop="none", lease="acquire", power="on", power_timeout_s=1.0, rpc_timeout_s=1.0
        )
        self.keep_alives: list[KeepAlive] = []
        self.robot = SimpleNamespace(power_on=self._power_on)
        self.lease_wallet = SimpleNamespace(get_lease=lambda: self.keep_alives[-1].number)

    def grant(self, owner: str) -> int:
        self.number += 1
        self.owner = owner
        return self.number

    def refused(self, number: int) -> Exception | None:
        """What using a lease comes to."""
        if (self.owner, number) == (US, self.number):
            return None
        return not_ours(self.owner)

    # --- as the link and the lease's client ---------------------------------------------------
    def client(self, _: str) -> Robot:
        return self

    def retain_lease(self, number: int, timeout: float) -> None:
        if (error := self.refused(number)) is not None:
            raise error

    def read(self) -> Reading:
        state = SimpleNamespace(estops=self.estops, motors_on=self.motors_on)
        return cast("Reading", state)

    def _power_on(self, **_: float) -> None:
        self.motors_on = True


class KeepAlive:
    """The SDK's thread, of which a test plays each step; its end waits for what is under way."""

    def __init__(
        self, robot: Robot, on_failure_callback: Callable[[Exception], None], **_: Any
    ) -> None:
        if robot.owner == TABLET:
            raise claimed(TABLET)
        self._robot, self._tell = robot, on_failure_callback
        self.number, self.ended = robot.grant(US), False
        self._under_way: list[Exception | None] = []
        robot.keep_alives.append(self)

    def ask(self) -> None:
        """The robot answers a check of the lease; nobody has heard the answer yet."""
        if not self.ended:
            self._under_way.append(self._robot.refused(self.number))

    def hear(self) -> None:
        while self._under_way:
            error = self._under_way.pop(0)
            if error is not None:
                self._tell(error)

    def shutdown(self) -> None:
        self.ended = True
        self.hear()
        if self._robot.refused(self.number) is None:
            self._robot.owner = ""


class Scene:
    """The driver's right to move, at that robot."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.halt = robot, Halt()
        legs: Any = SimpleNamespace(stand=lambda: None)
        self.control = Control(cast("Any", robot), legs, self.halt)

    def act(self) -> None:
        """One action, as the driver does it. Raises Conflict."""
        self.halt.begin()
        try:
            self.control.take(self.robot.read())
            error = self.robot.refused(self.robot.keep_alives[-1].number)
            if error is not None:
                lost = translate(error, self.robot.host, "walk")
                self.control.lost(lost)
                raise lost
            self.halt.check()
        except Halted as halted:
            raise halted.error or Conflict(halted.reason) from None
        finally:
            self.halt.end()

    def take_by_hand(self) -> None:
        self.robot.grant(TABLET)

    def release_by_hand(self) -> None:
        self.robot.owner = ""


@pytest.fixture(autouse=True)
def no_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(api.lease, "LeaseKeepAlive", KeepAlive)


@pytest.fixture
def scene() -> Scene:
    return Scene(Robot())


def taken(scene: Scene) -> KeepAlive:
    """A person took the robot while it acted, and the action told of it; a check of the lease that
    failed likewise is still under way."""
    scene.act()
    check = scene.robot.keep_alives[-1]
    scene.take_by_hand()
    check.ask()
    with pytest.raises(Conflict, match="the tablet has taken the robot's lease"):
        scene.act()
    assert "then clear the stop" in scene.halt.stopped
    return check


@pytest.mark.parametrize("heard", ["before the next action", "in it", "after it"])
def test_a_check_that_failed_before_the_stop_was_cleared_never_stops_the_robot_after(
    scene: Scene, heard: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    check = taken(scene)
    if heard != "in it":  # where its thread is not waited for
        monkeypatch.setattr(KeepAlive, "shutdown", lambda _: None)
    scene.release_by_hand()
    scene.control.clear()
    if heard == "before the next action":
        check.hear()
    scene.act()
    check.hear()
    scene.act()
    assert not scene.halt.stopped


def test_a_stop_is_not_cleared_while_the_tablet_has_the_robot_and_the_answer_says_so(
    scene: Scene,
) -> None:
    taken(scene)
    told = scene.halt.stopped
    for _ in range(2):
        with pytest.raises(Conflict, match="cannot clear the stop: the tablet holds") as refused:
            scene.control.clear()
        assert "have it released there" in refused.value.message
        assert scene.halt.stopped == told
    scene.release_by_hand()
    scene.control.clear()
    scene.act()


def test_a_stop_is_not_cleared_while_an_e_stop_is_pressed(scene: Scene) -> None:
    taken(scene)
    scene.release_by_hand()
    scene.robot.estops = ("hardware button",)
    with pytest.raises(Conflict, match="cannot clear the stop: hardware button is pressed"):
        scene.control.clear()
    assert scene.halt.stopped
    scene.robot.estops = ()
    scene.control.clear()
    scene.act()


def test_motors_that_a_person_must_switch_on_keep_the_stop(scene: Scene) -> None:
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


def test_a_robot_that_was_taken_unnoticed_is_got_back_by_clearing_another_stop(
    scene: Scene,
) -> None:
    """Nobody has heard of the loss when stop-now is cleared; the check that tells comes after."""
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


def test_a_robot_that_is_taken_again_is_stopped_again(scene: Scene) -> None:
    taken(scene)
    scene.release_by_hand()
    scene.control.clear()
    scene.take_by_hand()
    check = scene.robot.keep_alives[-1]
    check.ask()
    check.hear()
    assert "the tablet has taken the robot's lease" in scene.halt.stopped
    with pytest.raises(Conflict, match="clear the stop"):
        scene.act()
    assert [k.ended for k in scene.robot.keep_alives] == [True, False]  # one thread for one lease


def test_a_lease_that_is_lost_in_an_action_ends_it_before_it_moves_on(scene: Scene) -> None:
    scene.act()
    scene.halt.begin()
    scene.take_by_hand()
    check = scene.robot.keep_alives[-1]
    check.ask()
    check.hear()
    with pytest.raises(Halted, match="the tablet has taken") as ended:
        scene.control.take(scene.robot.read())
    assert isinstance(ended.value.error, Conflict)


class AnyOrder(RuleBasedStateMachine):
    """Every order of a person's hands, the SDK's checks, actions and clears."""

    def __init__(self) -> None:
        super().__init__()
        self.scene = Scene(Robot())
        self.taken_since_clear = False

    @rule()
    def somebody_takes_it(self) -> None:
        self.taken_since_clear = True
        self.scene.take_by_hand()

    @precondition(lambda self: self.scene.robot.owner == TABLET)
    @rule()
    def somebody_releases_it(self) -> None:
        self.scene.release_by_hand()

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
        told = ""
        try:
            self.scene.control.clear()
        except Conflict as error:
            told = error.message
        if told:
            assert self.scene.robot.owner == TABLET
            assert "the tablet holds the robot's lease; have it released there" in told
        else:
            self.taken_since_clear = False
        assert bool(told) == bool(self.scene.halt.stopped)

    @rule()
    def it_acts(self) -> None:
        held, stopped = self.scene.control.held, self.scene.halt.stopped
        ours = self.scene.robot.owner == US
        try:
            self.scene.act()
        except Conflict:
            assert stopped or not ours
            assert self.scene.halt.stopped or not held  # what was lost in an action is latched
        else:
            assert not stopped

    @invariant()
    def only_a_loss_after_the_last_clear_stops_it(self) -> None:
        assert not self.scene.halt.stopped or self.taken_since_clear


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = how(max_examples=60, stateful_step_count=15, deadline=None)
