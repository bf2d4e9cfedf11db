"""The suite on the scorer that was chosen; collected by `python -m helios_contract`."""

from __future__ import annotations

from helios_contract import command_line_choice
from helios_contract.bench import ScorerBench
from helios_contract.plugin_suite import ScorerContract


class TestScorer(ScorerContract):
    """As named on the command line."""

    @classmethod
    def stand(cls) -> ScorerBench:
        assert command_line_choice.scorer is not None
        return command_line_choice.scorer
