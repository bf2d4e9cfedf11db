"""What `python -m helios_contract` was told to test."""

from helios_contract.bench import DetectorBench, ScorerBench
from helios_contract.rig import Rig

rig: Rig | None = None
detector: DetectorBench | None = None
scorer: ScorerBench | None = None
