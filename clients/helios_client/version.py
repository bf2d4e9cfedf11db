"""The version of the installed package."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

PACKAGE = "helios-ovmm"


def helios_version() -> str:
    """As `pip` knows it; "not installed" where it runs from a folder alone."""
    try:
        return version(PACKAGE)
    except PackageNotFoundError:
        return "not installed"
