"""What must hold of every robot driver, as a suite of tests (`docs/your-own-robot.md`).

On one's own driver, from the shell:

    python -m helios_contract my_package:MyRobot

or among one's own tests:

    from helios_contract import DriverContract, Rig

    class TestMyRobot(DriverContract):
        @classmethod
        @contextmanager
        def stand(cls):
            yield Rig(MyRobot())
"""

import pytest

_CLAIMS = ("describing", "hosted", "moving", "seeing", "stopping")
pytest.register_assert_rewrite(*(f"helios_contract.{name}" for name in _CLAIMS))

from helios_contract.rig import Rig  # noqa: E402 - asserts are rewritten first
from helios_contract.suite import DriverContract  # noqa: E402

__all__ = ["DriverContract", "Rig"]
