"""Lets tests import `tests.support`; takes the time limit off every property test."""

import sys
from pathlib import Path

from hypothesis import settings

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

# How long an example takes says how busy the machine is. What may not take long is counted.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
