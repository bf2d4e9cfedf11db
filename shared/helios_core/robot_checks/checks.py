"""Checks of a robot's set-up, without a target, from the images that it takes anyway.

`RobotChecks` takes captures one after the other, keeps a few numbers of each, and says at any time
what it has found. Floor: pitch, roll and height of the camera. Edges: registration of depth and
colour. Alignment of depth images: distances and headings against the poses. Images while turning:
time offset. Not thread-safe.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from helios_core.geometry import Matrix, Pinhole, invert
from helios_core.robot import Capture
from helios_core.robot_checks import finding as f
from helios_core.robot_checks.attribution import scale_findings
from helios_core.robot_checks.finding import (
    Estimate,
    Finding,
    combined,
    judged,
    not_measured,
)
from helios_core.robot_checks.floor_plane import FloorView, floor_in_view
from helios_core.robot_checks.image_shift import ImageShift, image_shift
from helios_core.robot_checks.intrinsics import intrinsics_finding
from helios_core.robot_checks.scan_alignment import Alignment, PlaneField, align, plane_field
from helios_core.robot_checks.time_offset import WatchedTurn, time_offset

LEAST_VIEWS = 3  # of the floor, and with edges
SETTLED = 6  # images from which a warning may come while more are on their way
LEAST_DRIVE_M = 0.15  # between two images whose distance is compared
LEAST_DRIVES = 4
LEAST_TURN_RAD, LEAST_TURNED_RAD = math.radians(4), math.radians(80)  # of a pair; in all
NO_TURNS = (
    "the robot offers no turns: max_turn_rad is below 1 deg in its description; if it can turn, "
    "give max_turn_rad in its driver's describe()"
)
LARGEST_MOVE_M, LARGEST_TURN_RAD = 1.2, math.radians(40)  # between two images that are compared
YAW_ERROR_RAD, ALONG_ERROR_M = math.radians(0.6), 0.01  # larger errors say nothing


@dataclass
class _Pairs:
    """What the alignments of consecutive images measured."""

    distance: list[float] = field(default_factory=list)  # measured over claimed, less 1
    distance_error: list[float] = field(default_factory=list)
    claimed_rad: list[float] = field(default_factory=list)  # turn of the poses
    excess_rad: list[float] = field(default_factory=list)  # claimed less measured turn


class RobotChecks:
    """Checks of one robot: see the module."""

    def __init__(self, described: Pinhole | None = None, lacks_turns: bool = False) -> None:
        """described: intrinsics in the robot's description, to compare with those of images.

        lacks_turns: `MoveLimits.lacks_turns` of the robot; the checks that need turns are left out.
        """
        self._described, self._lacks_turns = described, lacks_turns
        self._last: tuple[Capture, PlaneField] | None = None
        self._floor: list[FloorView] = []
        self._shifts: list[ImageShift] = []
        self._pairs = _Pairs()
        self._turns: list[WatchedTurn] = []
        self._height_m = 0.0
        self._watched = 0
        self.views = 0  # images at rest that were added

    def add(self, capture: Capture) -> None:
        """Add an image that the robot took at rest."""
        self.views += 1
        floor = floor_in_view(capture.depth_m, capture.camera, capture.T_world_cam)
        if floor is not None:
            self._floor.append(floor)
            self._height_m = float(capture.T_world_cam[2, 3])
        shift = image_shift(capture.color, capture.depth_m)
        if shift is not None:
            self._shifts.append(shift)
        field_now = plane_field(capture.depth_m, capture.camera)
        if self._last is not None:
            self._compare(*self._last, capture, field_now)
        self._last = capture, field_now

    def add_watched(self, captures: Sequence[Capture]) -> None:
        """Add images that the robot took while it turned, after the newest image at rest."""
        if self._last is None or len(captures) < 2:
            return
        self._watched += len(captures)
        start, planes = self._last
        rows = []
        for capture in captures:
            T_claimed = invert(capture.T_world_cam) @ start.T_world_cam
            if abs(_yaw_between(T_claimed, capture.T_world_cam)) > LARGEST_TURN_RAD:
                continue
            there = plane_field(capture.depth_m, capture.camera)
            found = align(planes, there, T_claimed, search=True)
            if found is None or _yaw_error(found, capture.T_world_cam) > YAW_ERROR_RAD:
                continue
            claimed_rad = _yaw_between(T_claimed, capture.T_world_cam)
            seen_rad = _yaw_between(found.T_b_a, capture.T_world_cam)
            rows.append((capture.stamp_ns * 1e-9, claimed_rad, seen_rad))
        if rows:
            self._turns.append(WatchedTurn(*np.array(rows, float).T))

    def findings(self) -> tuple[Finding, ...]:
        """Results of all checks so far."""
        intrinsics = intrinsics_finding(self._last and self._last[0].camera, self._described)
        if intrinsics.verdict == "wrong":  # every other check depends on them
            mend = "mend the intrinsics first"
            return (*(not_measured(c, mend) for c in f.CHECKS if c != f.INTRINSICS), intrinsics)
        height, scale, distance = scale_findings(
            self._height(), self._height_m, self._distance_ratio()
        )
        return (
            *self._tilts(),
            height,
            scale,
            self._registration(),
            self._offset(),
            self._heading(),
            distance,
            intrinsics,
        )

    # --- one image, two images ----------------------------------------------------------------
    def _compare(
        self, before: Capture, planes: PlaneField, now: Capture, planes_now: PlaneField
    ) -> None:
        T_claimed = invert(now.T_world_cam) @ before.T_world_cam
        way_m = float(np.linalg.norm(now.T_world_base[:2, 3] - before.T_world_base[:2, 3]))
        turn_rad = _yaw_between(T_claimed, now.T_world_cam)
        tilted = abs(float(now.T_world_cam[2, 2] - before.T_world_cam[2, 2])) > 0.02
        if tilted or way_m > LARGEST_MOVE_M or abs(turn_rad) > LARGEST_TURN_RAD:
            return
        if way_m < LEAST_DRIVE_M and abs(turn_rad) < LEAST_TURN_RAD:
            return
        found = align(planes, planes_now, T_claimed)
        if found is None:
            return
        if abs(turn_rad) >= LEAST_TURN_RAD and _yaw_error(found, now.T_world_cam) < YAW_ERROR_RAD:
            self._pairs.claimed_rad.append(turn_rad)
            seen_rad = _yaw_between(found.T_b_a, now.T_world_cam)
            self._pairs.excess_rad.append(turn_rad - seen_rad)
        claimed_m = float(np.linalg.norm(T_claimed[:3, 3]))
        if way_m < LEAST_DRIVE_M or claimed_m < LEAST_DRIVE_M:
            return
        along = T_claimed[:3, 3] / claimed_m
        error_m = math.sqrt(max(float(along @ found.covariance[3:, 3:] @ along), 0.0))
        if error_m < ALONG_ERROR_M:
            measured_m = float(found.T_b_a[:3, 3] @ along)
            self._pairs.distance.append(measured_m / claimed_m - 1.0)
            self._pairs.distance_error.append(error_m / claimed_m)

    # --- results ------------------------------------------------------------------------------
    def _tilts(self) -> tuple[Finding, Finding]:
        if len(self._floor) < LEAST_VIEWS:
            why = self._too_few("too little floor is seen", len(self._floor))
            return not_measured(f.PITCH, why), not_measured(f.ROLL, why)
        none = [0.0] * len(self._floor)
        down = combined([math.degrees(v.down_rad) for v in self._floor], none, f.PITCH.floor)
        right = combined([math.degrees(v.right_rad) for v in self._floor], none, f.ROLL.floor)
        assert down is not None
        assert right is not None
        looks, leans = "the camera looks {size} further", "the camera leans {size} further to the"
        than = "than its pose says"
        return (
            judged(
                f.PITCH,
                down,
                f"{looks} down {than}",
                f"{looks} up {than}",
                "the camera's pitch is as its pose says",
            ),
            judged(
                f.ROLL,
                right,
                f"{leans} right {than}",
                f"{leans} left {than}",
                "the camera's roll is as its pose says",
            ),
        )

    def _height(self) -> Estimate | None:
        """How much higher the camera is above the floor, as depth measures it, than claimed."""
        if len(self._floor) < LEAST_VIEWS:
            return None
        higher = [v.higher_m for v in self._floor]
        return combined(higher, [0.0] * len(higher), f.HEIGHT.floor)

    def _distance_ratio(self) -> Estimate | None:
        """Distances that depth images measure, against those of the poses, less 1."""
        if len(self._pairs.distance) < LEAST_DRIVES:
            return None
        return combined(self._pairs.distance, self._pairs.distance_error, 1e-2 * f.DISTANCE.floor)

    def _registration(self) -> Finding:
        if len(self._shifts) < LEAST_VIEWS:
            why = self._too_few("too few edges in common", len(self._shifts))
            return not_measured(f.REGISTRATION, why)
        none = [0.5] * len(self._shifts)
        right = combined([s.right_px for s in self._shifts], none, f.REGISTRATION.floor)
        down = combined([s.down_px for s in self._shifts], none, f.REGISTRATION.floor)
        assert right is not None
        assert down is not None
        lies = "the colour image lies {size}"
        of = "the depth image: their registration is off"
        if abs(right.value) >= abs(down.value):
            far, more, less = right, f"{lies} to the right of {of}", f"{lies} to the left of {of}"
        else:
            far, more, less = down, f"{lies} below {of}", f"{lies} above {of}"
        return judged(f.REGISTRATION, far, more, less, "colour and depth lie on each other")

    def _too_few(self, what: str, images: int) -> str:
        """Why a check of single images has no result: too few of them show something."""
        if self._lacks_turns and self.views < LEAST_VIEWS:
            return f"{self.views} of {LEAST_VIEWS} images came; {NO_TURNS}"
        return f"{what}: in {images} of {self.views} images"

    def _offset(self) -> Finding:
        if self._lacks_turns:
            return not_measured(f.TIME_OFFSET, f"left out: {NO_TURNS}")
        found = time_offset(self._turns)
        if found is None:
            why = (
                "no image was taken while the robot turned"
                if not self._watched
                else "the images taken while the robot turned show too little"
            )
            return not_measured(f.TIME_OFFSET, why)
        offset_s, error_s = found
        images = "the images are {size}"
        return judged(
            f.TIME_OFFSET,
            Estimate(offset_s, max(error_s, f.TIME_OFFSET.floor), 1),
            f"{images} older than their poses",
            f"{images} newer than their poses",
            "images and poses are of the same time",
        )

    def _heading(self) -> Finding:
        if self._lacks_turns:
            return not_measured(f.HEADING, f"left out: {NO_TURNS}")
        claimed, excess = np.array(self._pairs.claimed_rad), np.array(self._pairs.excess_rad)
        if np.abs(claimed).sum() < LEAST_TURNED_RAD or len(claimed) < LEAST_VIEWS:
            return not_measured(f.HEADING, "the robot has turned too little")
        per_turn = 360.0 * excess * np.sign(claimed) / np.abs(claimed).mean()
        found = combined(per_turn, [0.0] * len(per_turn), f.HEADING.floor)
        assert found is not None
        poses, turn = "the poses turn", "{size}, compared with the images"
        return judged(
            f.HEADING,
            found,
            f"{poses} too far by {turn}",
            f"{poses} too little by {turn}",
            "the poses turn as far as the images",
        )


def _yaw_between(T_b_a: Matrix, T_world_b: Matrix) -> float:
    """Turn from camera a to camera b about the world's vertical axis, rad."""
    R = T_world_b[:3, :3] @ T_b_a[:3, :3].T @ T_world_b[:3, :3].T
    return math.atan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])


def _yaw_error(found: Alignment, T_world_b: Matrix) -> float:
    """Standard error of a measured turn about the vertical axis, rad."""
    up = T_world_b[2, :3]
    return math.sqrt(max(float(up @ found.covariance[:3, :3] @ up), 0.0))
