"""Makes the helpers beside the tests importable, and a planner among its peers theirs."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from planner_bus import start

__all__ = ["start"]
