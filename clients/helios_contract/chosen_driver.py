"""Suite for the chosen driver; collected by `python -m helios_contract`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

from helios_contract import command_line_choice
from helios_contract.rig import Rig
from helios_contract.suite import DriverContract


class TestDriver(DriverContract):
    """Contract tests of the driver named on the command line."""

    @classmethod
    @contextmanager
    def stand(cls) -> Iterator[Rig]:
        assert command_line_choice.rig is not None
        with closing(command_line_choice.rig.driver):
            yield command_line_choice.rig
