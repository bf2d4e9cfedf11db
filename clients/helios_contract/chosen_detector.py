"""Suite for the chosen detector; collected by `python -m helios_contract`."""

from __future__ import annotations

from helios_contract import command_line_choice
from helios_contract.bench import DetectorBench
from helios_contract.plugin_suite import DetectorContract


class TestDetector(DetectorContract):
    """Contract tests of the detector named on the command line."""

    @classmethod
    def stand(cls) -> DetectorBench:
        assert command_line_choice.detector is not None
        return command_line_choice.detector
