"""Height, depth scale or odometry: which of them explains the measurements?

Two numbers are measured: how far the floor lies from where it is claimed, and how far the scene
moves against the poses while the robot drives. Three faults are possible. A depth scale shows in
both, by the same share; a wrong height only in the first; wrong odometry only in the second.
"""

from __future__ import annotations

import math

from helios_core.robot_checks import finding as f
from helios_core.robot_checks.finding import Estimate, Finding, judged, not_measured

MOUNT_ERROR_M = 0.004  # of a height that counts as right, when the depth scale is computed
SIGNIFICANT = 2.5  # standard errors that the drives must show
AGREES, DISAGREES = 0.5, 0.3  # shares of the drives' ratio, between it and the floor's
CLOSE = 1.5  # standard errors between the two ratios that also agree
NO_DRIVE = "only a drive tells the depth's scale: helios doctor --robot"
NO_FLOOR = "too little floor is seen"


def scale_findings(
    higher_m: Estimate | None, claimed_m: float, ratio: Estimate | None
) -> tuple[Finding, Finding, Finding]:
    """Findings on height, depth scale and distances.

    higher_m: height of the camera as depth measures it, less the claimed one. claimed_m: that one.
    ratio: distance driven as depth measures it over that of the poses, less 1.
    """
    if ratio is None:
        return (
            _height(higher_m, "; or depth reads too {way}: only a drive tells"),
            not_measured(f.DEPTH_SCALE, NO_DRIVE),
            not_measured(f.DISTANCE, "the robot has driven too little"),
        )
    if higher_m is None:
        return (
            _height(None, ""),
            not_measured(f.DEPTH_SCALE, NO_FLOOR),
            _distance(ratio, ", or depth is off by as much"),
        )
    share = Estimate(
        higher_m.value / claimed_m, math.hypot(higher_m.error, MOUNT_ERROR_M) / claimed_m, 1
    )
    agreement = abs(share.value - ratio.value)
    shows = abs(ratio.value) > SIGNIFICANT * ratio.error
    near = max(AGREES * abs(ratio.value), CLOSE * math.hypot(share.error, ratio.error))
    if shows and agreement < near:
        scale = _mean(share, ratio)
        rest = Estimate(higher_m.value - scale.value * claimed_m, higher_m.error, 1)
        return _height(rest, ""), _scale(scale), _distance(_zero(ratio), "")
    if shows and abs(share.value) > DISAGREES * abs(ratio.value):
        # Both are wrong, and not by the same share: no single fault explains them.
        more = ", or depth is off by as much"
        unclear = not_measured(f.DEPTH_SCALE, UNCLEAR)
        return _height(higher_m, "; or depth reads too {way}"), unclear, _distance(ratio, more)
    return _height(higher_m, ""), _scale(share if shows else ratio), _distance(ratio, "")


UNCLEAR = "floor and drives disagree in a way that one fault does not explain"


def _mean(a: Estimate, b: Estimate) -> Estimate:
    """Mean with weights by their errors."""
    wa, wb = a.error**-2, b.error**-2
    return Estimate((wa * a.value + wb * b.value) / (wa + wb), (wa + wb) ** -0.5, a.n + b.n)


def _zero(of: Estimate) -> Estimate:
    """Nothing, as well as the estimate could have shown something."""
    return Estimate(0.0, of.error, of.n)


def _height(higher_m: Estimate | None, more: str) -> Finding:
    if higher_m is None:
        return not_measured(f.HEIGHT, NO_FLOOR)
    than = "than its pose says"
    return judged(
        f.HEIGHT,
        higher_m,
        f"the camera is {{size}} higher {than}{more.format(way='long')}",
        f"the camera is {{size}} lower {than}{more.format(way='short')}",
        "the camera's height is as its pose says",
    )


def _scale(scale: Estimate) -> Finding:
    percent = Estimate(100 * scale.value, max(100 * scale.error, f.DEPTH_SCALE.floor), scale.n)
    return judged(
        f.DEPTH_SCALE,
        percent,
        "depth reads {size} too long",
        "depth reads {size} too short",
        "depth and driven distances agree",
    )


def _distance(ratio: Estimate, more: str) -> Finding:
    percent = Estimate(-100 * ratio.value, max(100 * ratio.error, f.DISTANCE.floor), ratio.n)
    return judged(
        f.DISTANCE,
        percent,
        f"the poses drive {{size}} too far{more}",
        f"the poses drive {{size}} too little{more}",
        "the poses drive as far as the images",
    )
