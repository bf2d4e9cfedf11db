"""Flow of a task that only moves the robot: to a point, home, or to explore the home."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from helios_planner.decisions import explanations
from helios_planner.decisions.acceptance import Candidate
from helios_planner.decisions.decision import Decision, DecisionRule, Do
from helios_planner.instruction.parser import Instruction, Kind
from helios_planner.navigation.base_controller import BlockedPath, base_controller_for
from helios_planner.navigation.point_goal import PointGoal, point_text
from helios_planner.robot.interface import RobotInterface
from helios_planner.search.exploration import Exploration
from helios_planner.settings import Settings
from helios_planner.task import Cause, Phase, TaskFailed, TimeIsUp
from helios_planner.tasks.run_control import LastAction

GO_WITHIN_M = 0.25  # stopping distance to a goal that the robot cannot stand on
HOME_WITHIN_M = 0.5  # the robot may have started in a place too narrow to return to


class MoveMission:
    """One motion task from start to end; `run` returns the message of its success."""

    seen_at_goal: bool | None = None  # nothing is placed

    def __init__(self, robot: RobotInterface, instruction: Instruction, settings: Settings) -> None:
        self.robot, self.instruction, self.settings = robot, instruction, settings
        self.base = base_controller_for(robot, settings)
        self.looked_around = False
        self.exploration = Exploration(self.base, settings)
        self.point_goal: PointGoal | None = None
        self._restored: Mapping[str, Any] = {"walls": []}

    def run(self) -> str:
        """Run the task; returns its message. Raises TaskFailed and TaskCancelled."""
        match self.instruction.kind:
            case Kind.EXPLORE:
                return self._explore()
            case Kind.GO_HOME:
                return self._go_home()
            case _:
                point = self.instruction.point
                assert point is not None
                return self._go((point.x_m, point.y_m), point.yaw_rad, GO_WITHIN_M, "the goal")

    # --- restart -------------------------------------------------------------------------------
    def checkpoint(self) -> dict[str, Any]:
        """State that must outlive a crash of the planner, as JSON, for `restore`."""
        going = self._restored if self.point_goal is None else self.point_goal.checkpoint()
        return {
            "looked_around": self.looked_around,
            "exploration": self.exploration.checkpoint(),
            "going": dict(going),
            **self.base.checkpoint(),
        }

    def restore(self, checkpoint: Mapping[str, Any], last: LastAction) -> None:
        """Restore the state. The robot's pose shows the outcome of the newest action."""
        self.looked_around = checkpoint["looked_around"]
        self.base.restore(checkpoint)
        self.exploration.restore(checkpoint["exploration"])
        self._restored = checkpoint["going"]

    # --- going ---------------------------------------------------------------------------------
    def _go_home(self) -> str:
        start = self.robot.start()
        if start is None:
            raise TaskFailed(
                Cause.UNREACHABLE, "the 2D map does not know yet where the robot started"
            )
        return self._go(start, None, HOME_WITHIN_M, "where it started")

    def _go(
        self,
        xy_m: tuple[float, float],
        yaw_rad: float | None,
        within_m: float,
        what: str,
    ) -> str:
        self._tell(f"going to {point_text(xy_m)}", xy_m)
        goal = PointGoal(self.base, xy_m, within_m, lambda barred: self._on_stage(xy_m, barred))
        goal.restore(self._restored)
        self.point_goal = goal
        left_m = goal.drive(yaw_rad, f"go to {point_text(xy_m)}")
        pose = self.robot.pose()
        facing = "" if yaw_rad is None else f", facing {math.degrees(pose.yaw_rad):.0f}°"
        return f"stands at {point_text(pose.xy)}{facing}, {left_m:.2f} m from {what}"

    def _on_stage(self, xy_m: tuple[float, float], barred: BlockedPath) -> None:
        why = explanations.way_ends(
            point_text(xy_m), *barred.stand, barred.before_m, barred.after_m
        )
        terms = {
            "way_m": barred.before_m,
            "unknown_m": barred.after_m,
            "total": -(barred.before_m + barred.after_m),
        }
        candidate = Candidate("frontier", "end of the known way", (*barred.stand, 0.0), terms)
        self.robot.listener.on_decision(
            Decision(DecisionRule.WAY_THROUGH_UNKNOWN, Do.GO_TO_FRONTIER, (candidate,), 0, why)
        )
        self._tell(why, xy_m)

    def _tell(self, message: str, xy_m: tuple[float, float]) -> None:
        self.robot.listener.on_phase(Phase.GO, point_text(xy_m), message)

    # --- exploring -----------------------------------------------------------------------------
    def _explore(self) -> str:
        """Explore the home. The end of the task's time ends it without failure."""
        exploration = self.exploration
        try:
            if not self.looked_around:
                self.robot.listener.on_phase(Phase.EXPLORE, "unknown floor", "looking around")
                if exploration.begin():
                    self.base.look_around()
                self.looked_around = True
            exploration.run()
        except TimeIsUp as end:
            return f"{exploration.said()}; {end.message}, {exploration.said_left()}"
        except TaskFailed as failure:
            raise TaskFailed(failure.cause, f"{failure.message}; {exploration.said()}") from failure
        return exploration.said_at_end()
