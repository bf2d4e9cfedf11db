"""Test object that the command line of `python -m helios_contract` names."""

from helios_contract.bench import DetectorBench, ScorerBench
from helios_contract.rig import Rig

rig: Rig | None = None
detector: DetectorBench | None = None
scorer: ScorerBench | None = None
