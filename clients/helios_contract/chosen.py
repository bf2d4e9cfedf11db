"""The driver that `python -m helios_contract` was told to test."""

from helios_contract.rig import Rig

rig: Rig | None = None
