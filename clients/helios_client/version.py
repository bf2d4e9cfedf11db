"""Version of the installed package."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

PACKAGE = "helios-ovmm"


def helios_version() -> str:
    """Version as `pip` reports it; "not installed" if HELIOS runs from a folder only."""
    try:
        return version(PACKAGE)
    except PackageNotFoundError:
        return "not installed"
