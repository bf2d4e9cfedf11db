"""Labels of map pictures are read whole."""

import numpy as np
from helios_map2d.picture import UNKNOWN_RGB, Sheet
from helios_map2d.state import MapRules, MapState


def ink_px(at_px: tuple[int, int]) -> int:
    """How many pixels a label changes."""
    sheet = Sheet(MapState(MapRules(size_cells=64), (0, 0), 0.0).published, 600)
    sheet.text("side table 0.48", at_px)
    return int((sheet.pixels != np.array(UNKNOWN_RGB)).any(-1).sum())


def test_a_label_at_an_edge_is_as_whole_as_one_in_the_middle() -> None:
    assert ink_px((590, 300)) == ink_px((200, 300)) > 0
