"""The suite on the scorer that was chosen; collected by `python -m helios_contract`."""

from __future__ import annotations

from helios_contract import chosen
from helios_contract.bench import ScorerBench
from helios_contract.plugin_suite import ScorerContract


class TestScorer(ScorerContract):
    """As named on the command line."""

    @classmethod
    def stand(cls) -> ScorerBench:
        assert chosen.scorer is not None
        return chosen.scorer
