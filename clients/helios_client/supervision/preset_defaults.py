"""Settings of services that `helios up` takes from the preset of the simulated home."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from helios_client.supervision.flag_checks import DEFAULT_PRESET


@dataclass(frozen=True)
class PresetDefaults:
    """Flags of services; None leaves a setting as the service reads it."""

    noise: str | None = None  # noise table of the simulated detector
    max_steps: int | None = None  # most actions of a task that sets no limit itself


def preset_defaults(
    robot: str, preset: str, detector: str, environment: Mapping[str, str]
) -> PresetDefaults:
    """Noise table and number of actions for the homes of a preset, as in `helios eval ovmm`.

    preset: a known one. A value in the environment or the settings file comes first. The services'
    own defaults suit `demo-v1`.
    """
    if robot != "sim" or preset == DEFAULT_PRESET:
        return PresetDefaults()
    from helios_core.settings import is_chosen
    from helios_sim.home.presets import (  # late import: it takes half a second
        noise_table_of,
        pick_and_place_steps_of,
    )

    draws_errors = detector == "simulated" and not is_chosen("detector", "noise", environment)
    sets_budget = not is_chosen("planner", "max_steps", environment)
    return PresetDefaults(
        noise=noise_table_of(preset) if draws_errors else None,
        max_steps=pick_and_place_steps_of(preset) if sets_budget else None,
    )
