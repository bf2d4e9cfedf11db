"""Attributions and listing of the baked models."""

from __future__ import annotations

from typing import Any

from helios_sim.assets.asset_pack import Model, Pack
from helios_sim.assets.sweethome_library import LICENCE_ADDRESSES

# Holders that a library's licence file requires in addition to the author in the catalogue.
_HOLDERS = {
    "Scopia": "Scopia Visual Interfaces Systems, s.l. (http://www.scopia.es) and eTeks",
    "KatorLegaz": "Andrew Kator & Jennifer Legaz",
    "Reallusion": "Reallusion (http://www.reallusion.com)",
    "BlendSwap-CC-BY": "Blend Swap",
    "BlendSwap-CC-0": "Blend Swap",
}


def _credit(model: Model) -> str:
    holder = _HOLDERS.get(model.key.partition("/")[0], "")
    return f"{model.author}, {holder}" if holder else model.author


def attributions(pack: Pack) -> str:
    """Author and licence of each model, as Markdown."""
    lines = [
        "# Attributions",
        "",
        "These models come from the furniture libraries of Sweet Home 3D, as packaged by Debian in",
        "`sweethome3d-furniture` (https://www.sweethome3d.com/importModels.jsp). They were",
        "changed: fewer triangles, smaller textures, no transparency, other scale. A picture of a",
        "home with them carries these attributions along.",
        "",
        *(f"- {name}: {address}" for name, address in LICENCE_ADDRESSES.items()),
        "",
        "| model | title | author | licence |",
        "|---|---|---|---|",
    ]
    for model in sorted(pack.models, key=lambda m: m.key):
        lines.append(f"| {model.key} | {model.title} | {_credit(model)} | {model.licence} |")
    return "\n".join(lines) + "\n"


def rows_of(pack: Pack) -> list[dict[str, Any]]:
    """Rows for `helios assets show`, sorted by class."""
    return [
        {
            "key": model.key,
            "title": model.title,
            "classes": list(model.classes),
            "size_m": [round(side, 3) for side in model.size_m],
            "triangles": sum(len(look.faces) for look in model.looks),
            "boxes": len(model.boxes),
            "surfaces": len(model.surfaces),
            "author": _credit(model),
            "licence": model.licence,
        }
        for model in sorted(pack.models, key=lambda m: (m.classes, m.key))
    ]
