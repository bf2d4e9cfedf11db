"""Homes generated from a seed: rooms, doorways, furniture, objects, and their MuJoCo model.

`generate_home(seed, PRESETS["demo-v1"])` returns a `Home`; `Home.spec()` is its model without a
robot.
"""

from helios_sim.home.generated_home import Home
from helios_sim.home.home_generator import generate_home
from helios_sim.home.home_types import (
    Doorway,
    Episode,
    Fixture,
    Receptacle,
    Room,
    SceneObject,
    Surface,
)
from helios_sim.home.presets import PRESETS, HomePreset

__all__ = [
    "PRESETS",
    "Doorway",
    "Episode",
    "Fixture",
    "Home",
    "HomePreset",
    "Receptacle",
    "Room",
    "SceneObject",
    "Surface",
    "generate_home",
]
