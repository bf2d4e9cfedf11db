"""Optional realistic furniture: Debian's `sweethome3d-furniture`, baked into the user's cache.

`bake()` makes a pack of it; `realistic()` is the dressing that `generate_home` takes. Baking needs
the extra `assets`; using a baked pack does not.
"""

from helios_sim.assets.dressing import Dressing, realistic
from helios_sim.assets.pack import Pack

__all__ = ["Dressing", "Pack", "realistic"]
