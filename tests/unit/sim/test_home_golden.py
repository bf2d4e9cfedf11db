"""Tests that published presets never change: their fields and a few homes are recorded here.

A failure means that a home of a published preset has changed: give the new preset a new name.
"""

import dataclasses

import pytest
from helios_sim.home import PRESETS, generate_home

DIGESTS = {
    "demo-v1": "ecdc94da560d8621",
    "ovmm-v1": "30d659f76a9417c5",
    "ovmm-large-v1": "3da5ee8cd02d5ef8",
}

# The complete home, with the poses in which objects come to rest.
DEMO_STRUCTURE = {
    0: "9fa3c9dbc801ca72fbbcc5683b8a9a94f57f0ec99b44b32dce277a5b9b117ff5",
    1: "46410b50984b6ee6ea1bd080c2a6ce32bca1b4866d82f5177802f9ee25d19b79",
    2: "ee21c7abc57f69aae1ca71089d09cc653c490f9816e578ab938d01aeb3c89d85",
    7: "b3e878adb3e0aa7f796c513f1322bf97ee9a3eb6cfaf2a4f04a27c8bc8161ead",
}

# Rooms, doorways and furniture; then also the objects, as they rest in MuJoCo 3.17.0.
OVMM_DRAWN = {
    0: (
        "7c89d4e94ed4c3899eb43bad5b22e021bb0886911d4aa29da6bfe234b752b97a",
        "b76f2f9c8ac2e2ce60bd5b06a6049cc620754294e8b44ee586e5908261e1663a",
    ),
    1: (
        "db5b7645c6b0f05c901fe2d600a9cdba4714935888d5ed0f8c571367456714d1",
        "7132439d0647cbe859e4485ed3118384a7a3c6217b7b47d939ce0d3a5db04e27",
    ),
    2: (
        "a392907682fe48f71617e3eda78f7bfa48a5a5f06e1f60e0a01428feebd092c3",
        "a5cbbbc0e11da2fae0782da290eee8ce7a49d808775243d21473a55b2e22bb41",
    ),
    7: (
        "868a2beeecb1de29e30209e3eb15c0aa6e56d30fc11986a5b53431d76aee25fc",
        "f0efe3bb8e3ba4c7f5efa37680451cb2f002a75b0ebde05f623a8383b06fc1e5",
    ),
    999: (
        "f87adc683ffbc1791490a3f20f11a6abcfb716878169843b622ab151f7f3522a",
        "cdb5125d71acd5c37a2ac0642cbe8e7e40a51bd6f1243117fa4570de9b0917b3",
    ),
}

LARGE_DRAWN = (
    "aea730cffaf0f5664767fdd5b23ddd384fde4e084be7dc4a7d1409fcfe753041",
    "a9abb35c62b45fe2573344a8e0c632835b1b47191db361ebee5a3fbae065f45d",
)


def test_the_fields_of_published_presets_do_not_change() -> None:
    assert {name: preset.digest() for name, preset in PRESETS.items()} == DIGESTS


def test_different_presets_have_different_digests() -> None:
    demo = PRESETS["demo-v1"]
    assert dataclasses.replace(demo, objects=(16, 21)).digest() != demo.digest()
    assert len(demo.digest()) == 16


@pytest.mark.parametrize("seed", DEMO_STRUCTURE)
def test_the_homes_of_the_demo_do_not_change(seed: int) -> None:
    assert generate_home(seed, PRESETS["demo-v1"]).structure_hash() == DEMO_STRUCTURE[seed]


@pytest.mark.parametrize("seed", OVMM_DRAWN)
def test_the_homes_of_the_benchmark_do_not_change(seed: int) -> None:
    home = generate_home(seed, PRESETS["ovmm-v1"])
    assert (home.drawn_hash(), home.structure_hash()) == OVMM_DRAWN[seed]


def test_the_large_homes_do_not_change() -> None:
    home = generate_home(0, PRESETS["ovmm-large-v1"])
    assert (home.drawn_hash(), home.structure_hash()) == LARGE_DRAWN
