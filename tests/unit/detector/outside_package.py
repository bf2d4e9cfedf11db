"""Writes an installed package with its own back ends, as a third party would publish it."""

from __future__ import annotations

from pathlib import Path

CODE = '''
import time
import numpy as np
from helios_core.types import Detection
from helios_detector.backend import DetectorBackend, Findings, ScorerBackend, Seen


class Patient(DetectorBackend):
    """Finds the first class that is asked for in the middle; takes its time."""

    def __init__(self, argument, options):
        self.name = f"patient:{argument}"
        self._pause_s = float(argument or 0)
        self._threads = options.threads

    def vocabulary(self):
        return None

    def refused(self, context):
        return {}

    def warm_up(self):
        if self._pause_s < 0:
            raise ValueError("time runs forward")

    def close(self):
        pass

    def detect(self, frame, context):
        time.sleep(self._pause_s)
        mask = np.zeros(frame.depth_m.shape, bool)
        mask[10:20, 10:20] = True
        name = context.classes[0].name
        return Findings((Detection(name, 0.9, (10, 10, 20, 20), mask),), (Seen(name, 0.9),))


class Half(ScorerBackend):
    name = "half"

    def __init__(self, argument, options):
        self._score = float(argument or 0.5)

    def score(self, frame, seen, prompts):
        return dict.fromkeys(prompts, self._score)

    def warm_up(self):
        pass

    def close(self):
        pass
'''
ENTRY_POINTS = """[helios.detectors]
patient = helios_outside:Patient

[helios.scorers]
half = helios_outside:Half
"""
METADATA = "Metadata-Version: 2.1\nName: helios-outside\nVersion: 1.0\n"


def write(folder: Path) -> Path:
    """A folder for the module path: `patient:SECONDS` detects, `half:SCORE` scores."""
    info = folder / "helios_outside-1.0.dist-info"
    info.mkdir(parents=True)
    (folder / "helios_outside.py").write_text(CODE)
    (info / "METADATA").write_text(METADATA)
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    return folder
