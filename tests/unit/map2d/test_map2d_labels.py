"""Labels of map pictures are drawn completely and do not overlap."""

from dataclasses import replace

import numpy as np
from helios_map2d.epoch_map import EpochMap
from helios_map2d.layers.frontiers import Frontier
from helios_map2d.layers.parameters import MapRules
from helios_map2d.pictures.canvas import FOOT_PX, INK_RGB, UNKNOWN_RGB, Canvas
from helios_map2d.pictures.label_placement import Rect, Wanted, lead, placed
from helios_map2d.pictures.map_picture import render
from hypothesis import given
from hypothesis import strategies as st

SIZE_PX = (600, 400)

boxes = st.tuples(st.floats(0, 560), st.floats(0, 380), st.floats(1, 40), st.floats(1, 20)).map(
    lambda b: (b[0], b[1], b[0] + b[2], b[1] + b[3])
)
labels = st.builds(Wanted, st.floats(20, 120), st.floats(8, 20), boxes)


def overlap(a: Rect, b: Rect) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def ink_px(at_px: tuple[int, int]) -> int:
    """The number of pixels that a label changes."""
    sheet = Canvas(EpochMap(MapRules(size_cells=64), (0, 0), 0.0).published.grid, 600)
    sheet.text("side table 0.48", at_px)
    return int((sheet.pixels != np.array(UNKNOWN_RGB)).any(-1).sum())


def test_a_label_at_the_edge_is_drawn_completely() -> None:
    assert ink_px((590, 300)) == ink_px((200, 300)) > 0


@given(st.lists(labels, max_size=30), boxes)
def test_labels_stay_inside_and_overlap_neither_each_other_nor_reserved_areas(
    wanted: list[Wanted], taken: Rect
) -> None:
    places = placed(wanted, SIZE_PX, [taken])
    assert len(places) == len(wanted)
    found = [place for place in places if place is not None]
    for k, place in enumerate(found):
        assert place[0] >= 0 <= place[1]
        assert place[2] <= SIZE_PX[0]
        assert place[3] <= SIZE_PX[1]
        assert not any(overlap(place, other) for other in [taken, *found[:k]])


def test_many_objects_in_one_place_all_get_a_label() -> None:
    wanted = [Wanted(100, 14, (300, 200, 320, 210))] * 12
    places = placed(wanted, SIZE_PX)
    assert None not in places
    assert lead(places[0] or (0, 0, 0, 0), wanted[0].box_px) is None
    assert lead(places[-1] or (0, 0, 0, 0), wanted[-1].box_px) is not None


def test_a_single_object_has_its_label_directly_above() -> None:
    assert placed([Wanted(100, 14, (300, 200, 320, 210))], SIZE_PX) == [(300, 182, 400, 196)]


def test_only_a_reachable_frontier_shows_its_value() -> None:
    """An unreachable one is drawn without text: there may be many, behind every chair."""
    state = EpochMap(MapRules(size_cells=64), (0, 0), 0.0)
    cells = np.array([[30, 30], [30, 31], [31, 31]], np.int32)

    def ink(reachable: bool, values: dict[str, float]) -> int:
        frontier = Frontier(1, (0.0, 0.0), 3, reachable, values, cells)
        picture = render(replace(state.published, frontiers=(frontier,)), size_px=400)
        return int((picture[: 400 - FOOT_PX] == np.array(INK_RGB)).all(-1).sum())

    assert ink(True, {"pick": 0.5}) > ink(True, {}) == 0
    assert ink(False, {"pick": 0.5}) == 0
