"""Optional realistic furniture: Debian's `sweethome3d-furniture`, baked into the user's cache.

`bake()` makes a pack of it; `realistic()` is the dressing that `generate_home` takes. Baking needs
the extra `assets`; using a baked pack does not.
"""

from helios_sim.assets.asset_pack import Pack
from helios_sim.assets.home_furnishing import Dressing, realistic

__all__ = ["Dressing", "Pack", "realistic"]
