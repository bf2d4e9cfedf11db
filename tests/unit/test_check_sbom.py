"""The bill of materials is compared with the locked versions."""

from __future__ import annotations

from scripts.check_sbom import differences

LOCKED = "# why\nattrs==26.1.0\nTorch==2.13.0\nruamel.yaml==0.18\n"


def test_packages_with_other_versions_or_without_a_lock_are_named() -> None:
    names = {
        "attrs": "26.1.0",
        "torch": "2.13.0+cpu",
        "ruamel-yaml": "0.17",
        "left-pad": "1.0",
        "helios-ovmm": "0.2.0",
    }
    bill = {"components": [{"name": n, "version": v} for n, v in names.items()]}
    assert differences(bill, LOCKED) == [
        "ruamel-yaml 0.17: constraints.txt has 0.18",
        "left-pad 1.0: constraints.txt has no such package",
    ]
