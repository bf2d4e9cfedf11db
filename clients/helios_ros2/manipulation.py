"""Pick and place, by actions of the user's or by a person who is asked; show, by an action."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from helios_ros2.action_call import RosAction, filled
from helios_ros2.earlier_goals import EarlierGoals
from helios_ros2.offered_qos import Qos
from helios_ros2.rclpy_loading import interface
from helios_ros2.robot_input import RobotInput
from helios_ros2.ros_node import RosNode, qos_profile
from helios_ros2.settings import Ros2Settings, UserAction
from helios_ros2.stop_latch import NotDone, StopLatch

POLL_S = 0.05
Point = tuple[float, float, float]


class Manipulation:
    """The hand, and the object that the robot holds. For one thread, except `cancel`."""

    def __init__(
        self, ros: RosNode | None, settings: Ros2Settings, senses: RobotInput, latch: StopLatch
    ) -> None:
        """ros: None without rclpy's actions and services; then it neither picks nor places.

        Raises InvalidInput for an action whose type is not installed.
        """
        self._s, self._senses, self._latch = settings, senses, latch
        self._actions: dict[str, RosAction] = {}
        if ros is not None:
            for what, given in (
                ("pick", settings.pick),
                ("place", settings.place),
                ("show", settings.show),
                ("carry", settings.carry),
            ):
                if given is not None:
                    self._actions[what] = RosAction(ros, given.action, given.type)
        self.held = ""  # name of the held object
        # Where the hand holds it before the camera, from the base; None: it is carried.
        self._shown_at_m: Point | None = None
        self._person = Person(ros, settings, latch) if ros and settings.ask_person else None

    @property
    def can_pick(self) -> bool:
        return "pick" in self._actions or self._person is not None

    @property
    def can_place(self) -> bool:
        return "place" in self._actions or self._person is not None

    @property
    def can_show(self) -> bool:
        return "show" in self._actions

    def pick(self, point_m: Point, name: str) -> None:
        """Raises NotDone."""
        if self.held:
            raise NotDone(f"the robot holds the {self.held} already; place it first")
        self._check_reach(point_m)
        self._do("pick", self._s.pick, point_m, name, f"Please give me the {name}")
        self.held = name

    def place(self, point_m: Point) -> None:
        """Raises NotDone."""
        if not self.held:
            raise NotDone("the robot holds nothing; pick something first")
        self._check_reach(point_m)
        self.draw_in()
        self._do("place", self._s.place, point_m, self.held, f"Please put the {self.held} down")
        self.held = ""

    def show(self, angle_rad: float) -> None:
        """Raises NotDone."""
        shown_at, given = self._s.show_base_m, self._s.show
        if shown_at is None or given is None or not self.can_show:
            raise NotDone("this robot cannot show an object; HELIOS_ROS2_SHOW names an action")
        if not self.held:
            raise NotDone("the robot holds nothing to show; pick something first")
        self._shown_at_m = shown_at
        self._run("show", given, self._world_point(shown_at), self.held, angle_rad)

    def draw_in(self) -> None:
        """Hold the object as before it was shown. Raises NotDone."""
        if self._shown_at_m is None:
            return
        if self._s.carry is not None and "carry" in self._actions:
            self._run("carry", self._s.carry, self._world_point(self._shown_at_m), self.held)
        self._shown_at_m = None

    def cancels(self, until_s: float = 0.0) -> list[Callable[[], None]]:
        """Calls, from any thread, of which one ends the running action. Each waits for the answer
        until a monotonic time."""
        return [partial(action.cancel, until_s) for action in self._actions.values()]

    def earlier_goals(self) -> list[EarlierGoals]:
        """The goals of each action from before this process."""
        return [action.earlier for action in self._actions.values()]

    def _do(
        self, what: str, given: UserAction | None, point_m: Point, name: str, words: str
    ) -> None:
        x, y, z = point_m
        if given is None or what not in self._actions:
            if self._person is None:
                raise NotDone(
                    f"this robot cannot {what}; HELIOS_ROS2_{what.upper()} names an action"
                )
            self._person.ask(f"{words} at x = {x:.2f} m, y = {y:.2f} m, z = {z:.2f} m")
            return
        self._run(what, given, point_m, name)

    def _run(
        self, what: str, given: UserAction, point_m: Point, name: str, angle_rad: float = 0.0
    ) -> None:
        action, (x, y, z) = self._actions[what], point_m
        values = {
            "x": x,
            "y": y,
            "z": z,
            "angle": angle_rad,
            "name": name,
            "frame": self._senses.world_frame,
        }
        goal = action.goal(filled(given.goal, values))
        result = action.run(goal, self._latch, self._s.hand_timeout_s)
        if given.success and not getattr(result, given.success, False):
            raise NotDone(f"the action {given.action} says {given.success} = false")

    def _world_point(self, base_m: Point) -> Point:
        x, y, z = (self._senses.here().T_world_base @ [*base_m, 1.0])[:3].tolist()
        return x, y, z

    def _check_reach(self, point_m: Point) -> None:
        here = self._senses.here().T_world_base
        away_m = math.hypot(point_m[0] - here[0, 3], point_m[1] - here[1, 3])
        if away_m > self._s.reach_m + 0.3:
            raise NotDone(
                f"it is {away_m:.2f} m away, the reach is {self._s.reach_m:.2f} m; drive nearer"
            )


class Person:
    """A person who is asked on a topic and answers by a service."""

    def __init__(self, ros: RosNode, settings: Ros2Settings, latch: StopLatch) -> None:
        self._latch, self._within_s = latch, settings.hand_timeout_s
        self._text = interface("std_msgs/msg/String")
        trigger = interface("std_srvs/srv/Trigger")
        top = f"/{settings.node}"
        self._topic = f"{top}/request"
        self._publisher = ros.node.create_publisher(
            self._text, self._topic, qos_profile(Qos(retained=True), 1)
        )
        self._asked, self._answer = False, ""
        for name, answer in (("done", "done"), ("refuse", "refused")):
            ros.node.create_service(
                trigger, f"{top}/{name}", lambda q, a, answer=answer: self._on_answer(answer, a)
            )

    def ask(self, words: str) -> None:
        """Ask, and wait for the answer. Raises NotDone if it is no, or does not come."""
        self._asked, self._answer = True, ""
        self._publisher.publish(self._text(data=words))
        end_s = time.monotonic() + self._within_s
        try:
            while not self._answer:
                if time.monotonic() > end_s:
                    raise NotDone(
                        f"nobody answered within {self._within_s:g} s; a person answers "
                        f"{self._topic} by the service …/done or …/refuse"
                    )
                self._latch.rest(POLL_S)
        finally:
            self._asked = False
            self._publisher.publish(self._text(data=""))
        if self._answer != "done":
            raise NotDone("the person refused; try another object")

    def _on_answer(self, answer: str, response: Any) -> Any:
        response.success = self._asked
        response.message = answer if self._asked else "nothing was asked"
        if self._asked:
            self._answer = answer
        return response
