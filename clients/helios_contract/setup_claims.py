"""Contract tests of the robot's set-up: the checks of `helios doctor --robot`."""

from __future__ import annotations

from typing import ClassVar

import pytest
from helios_core.robot_checks.direct_run import check_driver
from helios_core.robot_checks.finding import CHECKS, Finding

from helios_contract.rig import Rig


class SetupClaims:
    """Contract tests of camera pose, depth and times. The robot turns once on the spot."""

    _findings: ClassVar[dict[str, Finding] | None] = None

    @pytest.mark.parametrize("check", [check.name for check in CHECKS])
    def test_the_set_up_is_right(self, rig: Rig, check: str) -> None:
        rig.need_motion()
        kind = type(self)
        if kind._findings is None:
            findings = check_driver(rig.driver, drive=False)
            kind._findings = {finding.name: finding for finding in findings}
        finding = kind._findings[check]
        if finding.verdict == "not measured":
            pytest.skip(finding.words)
        assert finding.verdict == "ok", finding.words
