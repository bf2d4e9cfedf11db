"""Suite for the chosen scorer; collected by `python -m helios_contract`."""

from __future__ import annotations

from helios_contract import command_line_choice
from helios_contract.bench import ScorerBench
from helios_contract.plugin_suite import ScorerContract


class TestScorer(ScorerContract):
    """Contract tests of the scorer named on the command line."""

    @classmethod
    def stand(cls) -> ScorerBench:
        assert command_line_choice.scorer is not None
        return command_line_choice.scorer
