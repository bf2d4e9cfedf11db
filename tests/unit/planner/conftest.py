"""Make the helper modules of this folder importable, and provide fixtures `start` and `group`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from planner_bus import start
from planner_group import group

__all__ = ["group", "start"]
