"""Homes by seed: rooms and doorways, furniture, things on it, and the MuJoCo model of all that.

`generate_home(seed, PRESETS["demo-v1"])` gives a `Home`; `Home.spec()` the model without a robot.
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
