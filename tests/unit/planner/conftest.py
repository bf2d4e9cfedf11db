"""Makes the helpers beside the tests importable, and `start` and `group` fixtures of all."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from planner_bus import start
from planner_group import group

__all__ = ["group", "start"]
