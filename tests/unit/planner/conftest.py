"""Makes the helpers beside the tests importable, and `start` and `house` fixtures of all."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from planner_bus import start
from planner_house import house

__all__ = ["house", "start"]
