"""Complete driver suite: one class, subclassed once per driver."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack
from typing import ClassVar

import pytest

_CLAIMS = ("bridge", "camera", "description", "motion", "pose_origin", "setup", "stop")
pytest.register_assert_rewrite(*(f"helios_contract.{name}_claims" for name in _CLAIMS))

from helios_contract.bridge_claims import BridgeClaims  # noqa: E402
from helios_contract.camera_claims import CameraClaims  # noqa: E402
from helios_contract.description_claims import DescriptionClaims  # noqa: E402 - so that asserts say their values
from helios_contract.motion_claims import MotionClaims  # noqa: E402
from helios_contract.pose_origin_claims import PoseOriginClaims  # noqa: E402
from helios_contract.rig import Rig  # noqa: E402
from helios_contract.setup_claims import SetupClaims  # noqa: E402
from helios_contract.stop_claims import StopClaims  # noqa: E402


class DriverContract(
    DescriptionClaims,
    PoseOriginClaims,
    CameraClaims,
    MotionClaims,
    SetupClaims,
    StopClaims,
    BridgeClaims,
):
    """All contract tests of one driver, which they share.

    Subclass it under a name that begins with Test, and construct the driver in `stand`.
    """

    _ending: ClassVar[ExitStack]
    _rig: ClassVar[Rig]

    @classmethod
    def stand(cls) -> AbstractContextManager[Rig]:
        """Context manager with a ready driver, which it closes at its end."""
        raise NotImplementedError("say how the driver is made: def stand(cls), a context of a Rig")

    @classmethod
    def setup_class(cls) -> None:
        cls._ending = ExitStack()
        cls._rig = cls._ending.enter_context(cls.stand())

    @classmethod
    def teardown_class(cls) -> None:
        cls._ending.close()

    @pytest.fixture
    def rig(self) -> Iterator[Rig]:
        """Rig of one test, with the stop cleared before and after."""
        self._rig.driver.clear_stop()
        yield self._rig
        self._rig.driver.clear_stop()
