"""Conversion of faults to HTTP models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, cast

from helios_gateway import api_fault_models
from helios_gateway.faults.fault_files import RecordingNote
from helios_gateway.faults.fault_monitor import FaultMonitor
from helios_gateway.faults.life_cycle import Fault


def fault_list(monitor: FaultMonitor) -> api_fault_models.FaultList:
    notes = monitor.recordings()
    return api_fault_models.FaultList(
        faults=[fault_model(fault, notes) for fault in monitor.faults()],
        recordings=[
            api_fault_models.FaultRecording(
                name=note.name,
                made_s=note.made_s,
                faults=list(note.faults),
                tasks=list(note.tasks),
                bytes=note.bytes or None,
            )
            for note in notes
        ],
        folder=None if monitor.folder is None else str(monitor.folder),
    )


def fault_model(fault: Fault, notes: Sequence[RecordingNote]) -> api_fault_models.Fault:
    """notes: all recordings, newest first."""
    return api_fault_models.Fault(
        id=fault.id,
        source=fault.source,
        kind=fault.kind,
        severity=cast(Literal["warning", "error"], fault.severity),
        state=cast(Literal["raised", "confirmed", "cleared"], fault.state.value),
        message=fault.message,
        count=fault.count,
        first_s=fault.first_s or None,
        last_s=fault.last_s or None,
        raised_s=fault.raised_s or None,
        confirmed_s=fault.confirmed_s or None,
        cleared_s=fault.cleared_s or None,
        recordings=[note.name for note in reversed(notes) if fault.id in note.faults],
    )
