"""Makes the helpers beside the tests importable, and `start` a fixture of all."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from planner_bus import start

__all__ = ["start"]
