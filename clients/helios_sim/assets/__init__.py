"""Optional realistic furniture: Debian's `sweethome3d-furniture`, baked into the user's cache.

`bake()` creates a pack of models; `realistic()` returns the furniture models of that pack for
`generate_home`. Baking needs the extra `assets`; using a baked pack does not.
"""

from helios_sim.assets.asset_pack import Pack
from helios_sim.assets.home_furnishing import FurnitureReplacement, realistic

__all__ = ["FurnitureReplacement", "Pack", "realistic"]
