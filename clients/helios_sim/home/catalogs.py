"""Catalogs by name, as `HomePreset.catalog` refers to them."""

from helios_sim.home.catalog import DEMO, Catalog
from helios_sim.home.catalog_ovmm import OVMM

CATALOGS: dict[str, Catalog] = {"demo": DEMO, "ovmm": OVMM}
