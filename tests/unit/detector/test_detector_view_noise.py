"""Correlated errors of the view noise: their rates and their persistence."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from helios_core.errors import InvalidInput
from helios_core.name_rules import plain
from helios_detector.lexical_scorer import household_names
from helios_detector.simulation.frame_noise import load_noise
from helios_detector.simulation.ground_truth_detector import Visible
from helios_detector.simulation.view_noise import (
    SectorViews,
    Shares,
    key_of,
    keys_of,
    normal_draws,
    sectors_of,
    uniform,
)
from helios_detector.simulation.view_noise_detector import SimulatedResult, verdicts
from helios_detector.simulation.view_noise_table import ViewNoiseTable, view_table
from helios_detector.simulator_truth import TruthInstance
from helios_sim.home.catalogs import CATALOGS
from hypothesis import given, settings
from hypothesis import strategies as st

_loaded = load_noise("ovmm-v1")
assert isinstance(_loaded, ViewNoiseTable)
# Rates far from their limits, so that the tests do not depend on the shipped scales.
_MILD = _loaded.file.scale.model_copy(
    update={"confuse": 0.5, "second": 0.5, "miss": 1.0, "false": 1.0}
)
TABLE: ViewNoiseTable = replace(_loaded, file=_loaded.file.model_copy(update={"scale": _MILD}))
CORRELATIONS = (0.0, None, 1.0)
KEYS = [key_of(f"thing {n}") for n in range(3000)]
PURPOSE = keys_of(("miss",))


def visible_object(class_name: str = "mug", pixels: int = 400) -> Visible:
    instance = TruthInstance(1, class_name, np.zeros(3), True, "a")
    return Visible(instance, pixels, (0, 0, 1, 1), np.ones((1, 1), bool))


def at(angle_deg: float, distance_m: float = 2.5) -> np.ndarray:
    turn = math.radians(angle_deg)
    return np.array([distance_m * math.cos(turn), distance_m * math.sin(turn), 0.0])


def look(
    table: ViewNoiseTable, thing: Visible, eye_m: np.ndarray, stamp_ns: int = 1
) -> list[SimulatedResult]:
    """The results for one object with 3000 different random keys."""
    return verdicts([thing] * len(KEYS), table, KEYS, eye_m, stamp_ns)


def about(count: int, probability: float, of: int) -> bool:
    """Within 4.5 standard deviations of the binomial distribution."""
    return abs(count - of * probability) <= 4.5 * math.sqrt(of * probability * (1 - probability))


def draws(sector: int, shares: Shares, stamp_ns: int = 1, cell: int = 0) -> np.ndarray:
    n = len(KEYS)
    cells = np.full(n, sector + 12 * cell)
    views = SectorViews(np.array(KEYS, np.uint64), np.full(n, sector), cells)
    return normal_draws(views, PURPOSE, shares, stamp_ns)[:, 0]


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(a, b)[0, 1])


@pytest.mark.parametrize("correlated", CORRELATIONS)
def test_correlation_does_not_change_the_rates_of_misses_confusions_and_double_names(correlated):
    table = TABLE.scaled(1, correlated)
    thing = visible_object()
    found = look(table, thing, at(10))
    miss = float(table.miss(["mug"], np.array([400]), np.array([2.5]))[0])
    assert about(sum(not v.names for v in found), miss, len(found))
    reported = [v.names for v in found if v.names]
    assert about(sum(n[0][0] != "mug" for n in reported), table.confuse("mug"), len(reported))
    assert about(sum(len(n) == 2 for n in reported), table.second("mug"), len(reported))


@pytest.mark.parametrize("correlated", CORRELATIONS)
def test_each_look_alike_is_named_at_the_rate_of_its_row(correlated):
    table = TABLE.scaled(1, correlated)
    never = table.file.miss.model_copy(update={"factor": {"bowl": 1e-9}})
    table = replace(table, file=table.file.model_copy(update={"miss": never}))
    got = Counter(v.names[0][0] for v in look(table, visible_object("bowl"), at(10)))
    for name, probability in TABLE.file.confusion.rows()["bowl"].items():
        assert about(got[name], probability * table.file.scale.confuse, len(KEYS)), name


@pytest.mark.parametrize("correlated", CORRELATIONS)
@pytest.mark.parametrize("sector", [0, 1, 2])
def test_draws_are_uniform_for_all_shares(correlated, sector):
    u = uniform(draws(sector, TABLE.scaled(1, correlated).shares))
    for count in np.histogram(u, 10, (0, 1))[0]:
        assert about(count, 0.1, len(u))


@settings(max_examples=40, deadline=None)
@given(shares=st.tuples(*[st.floats(0.01, 1)] * 4), sector=st.integers(0, 11), stamp=st.integers(0))
def test_any_shares_give_draws_of_unit_variance(shares, sector, stamp):
    s = Shares(*(x / sum(shares) for x in shares))
    z = draws(sector, s, stamp % 2**63)
    assert abs(z.mean()) < 0.1
    assert 0.85 < z.std() < 1.15


def test_frames_of_one_view_differ_by_the_frame_share_only():
    same = TABLE.scaled(1, 1.0).shares
    np.testing.assert_array_equal(draws(3, same, 1), draws(3, same, 2))
    assert abs(correlation(draws(3, TABLE.shares, 1), draws(3, TABLE.shares, 2)) - 0.9) < 0.03
    none = TABLE.scaled(1, 0.0).shares
    assert abs(correlation(draws(3, none, 1), draws(3, none, 2))) < 0.08


def test_at_even_odds_one_frame_in_seven_differs_from_the_previous_frame():
    """The share is that of the module docstring: acos(0.9) / pi."""
    changed = (draws(3, TABLE.shares, 1) < 0) != (draws(3, TABLE.shares, 2) < 0)
    assert about(int(changed.sum()), math.acos(0.9) / math.pi, len(changed))


@pytest.mark.parametrize("correlated", [None, 1.0])
def test_errors_correlate_more_in_adjacent_sectors_than_a_quarter_or_half_turn_apart(correlated):
    shares = TABLE.scaled(1, correlated).shares
    for start in range(12):
        near, quarter, half = (
            correlation(draws(start, shares, 1), draws((start + k) % 12, shares, 2))
            for k in (1, 3, 6)
        )
        assert near > quarter + 0.1 > half
        assert abs(half - shares.thing) < 0.08  # the object's own share, the same from everywhere


def test_the_same_view_gives_the_same_error():
    table = TABLE.scaled(1, 1.0)
    first = look(table, visible_object(pixels=400), at(10), 1)
    # Same sector, same bands of distance and pixels, another frame.
    again = look(table, visible_object(pixels=400), at(25, 2.6), 99)
    assert [[n for n, _ in v.names] for v in first] == [[n for n, _ in v.names] for v in again]


def test_a_confusion_persists_less_the_farther_the_camera_moves_round_the_object():
    """With the table's own shares, in the next frame: same sector, next sector, opposite side."""

    def wrong(verdict: SimulatedResult) -> bool:
        return bool(verdict.names) and verdict.names[0][0] != "mug"

    first = [wrong(v) for v in look(TABLE, visible_object(), at(40), 1)]

    def still(angle_deg: float) -> float:
        later = look(TABLE, visible_object(), at(angle_deg), 2)
        return sum(a and wrong(b) for a, b in zip(first, later, strict=True)) / sum(first)

    same, next_one, opposite = still(45), still(70), still(220)
    assert same > 0.6
    assert same > next_one > opposite
    assert opposite < 0.45


def test_rates_grow_with_the_level_and_misses_at_a_low_level_remain_at_a_higher_level():
    thing, missed = visible_object(pixels=1500), {}
    for level in (0.0, 0.5, 1.0, 2.0):
        table = TABLE.scaled(level)
        found = look(table, thing, at(10, 1.2))
        missed[level] = {k for k, v in enumerate(found) if not v.names}
        base = float(TABLE.miss(["mug"], np.array([1500]), np.array([1.2]))[0])
        assert about(len(missed[level]), level * base, len(found)) or level == 0
        reported = [v.names[0][0] for v in found if v.names]
        wrong = sum(name != "mug" for name in reported)
        assert about(wrong, level * TABLE.confuse("mug"), len(reported))
    assert missed[0.0] == set()
    assert missed[0.5] < missed[1.0] < missed[2.0]


@pytest.mark.parametrize(
    ("kind", "rate", "most"),
    [
        ("miss", lambda t: float(t.miss(["mug"], np.array([3000]), np.array([1.0]))[0]), 1.0),
        ("confuse", lambda t: t.confuse("mug"), TABLE.file.confusion.most),
        ("second", lambda t: t.second("mug"), 1.0),
        ("false", lambda t: t.false(structure=True, is_object=True), 1.0),
    ],
)
def test_each_error_rate_is_proportional_to_its_scale_up_to_a_limit(kind, rate, most):
    def scaled(by: float) -> ViewNoiseTable:
        scale = TABLE.file.scale.model_copy(update={kind: by})
        return replace(TABLE, file=TABLE.file.model_copy(update={"scale": scale}))

    assert rate(scaled(0.5)) == pytest.approx(0.5 * rate(scaled(1.0)))
    assert rate(scaled(0.0)) == 0
    assert rate(scaled(1e9)) == most


def test_the_true_class_remains_the_likeliest_name_at_the_highest_level():
    for name in TABLE.rows:
        assert TABLE.scaled(10).confuse(name) < 0.5


def test_small_and_far_objects_are_missed_more_often():
    far, small, plain = (
        TABLE.miss(["mug"], np.array([px]), np.array([m]))[0]
        for px, m in ((1000, 8.0), (100, 2.0), (1000, 2.0))
    )
    assert far > plain < small


def test_no_threshold_separates_true_scores_from_false_scores():
    """At every threshold of the paper, each kind has scores above it and below it."""
    for threshold in (0.25, 0.35, 0.45):
        for kind in ("true", "confused", "false"):
            scores = [TABLE.score(kind, u, 500) for u in np.linspace(0, 1, 101)]
            assert 0.03 < np.mean(np.array(scores) < threshold) < 0.95, (kind, threshold)


def test_there_are_12_sectors_of_30_degrees():
    angles = np.radians([0, 29.9, 30.1, 179, 181, 359.9, -0.1])
    got = sectors_of(np.stack([np.cos(angles), np.sin(angles)], -1))
    assert got.tolist() == [0, 0, 1, 5, 6, 11, 11]


def test_draws_are_the_same_on_every_machine():
    views = SectorViews(keys_of(("a",)), np.array([4]), np.array([77]))
    z = normal_draws(views, keys_of(("miss", "score")), Shares(0.3, 0.4, 0.2, 0.1), 123456789)
    assert z[0] == pytest.approx([1.9081309387766416, 0.047867777442039655], abs=1e-9)


@pytest.mark.parametrize("catalog", sorted(CATALOGS))
def test_every_class_of_the_homes_has_a_row_and_every_task_can_name_it(catalog):
    c = CATALOGS[catalog]
    named = {plain(name) for name in (*c.objects, *c.receptacles)}
    assert named <= household_names()
    everything = named | {plain(name) for name in c.fixtures}
    assert everything <= TABLE.rows.keys()


def test_look_alikes_of_the_homes_are_confused_by_the_table():
    for names in CATALOGS["ovmm"].look_alikes:
        for name in names:
            others = set(names) - {name}
            assert others & set(TABLE.rows[plain(name)].names), name


@pytest.mark.parametrize(
    ("where", "value", "said"),
    [
        (("persistence", "thing"), 0.5, "add up to 1.2"),
        (("miss", "by_pixels"), [0.5], "probabilities"),
        (("miss", "by_distance"), [0.0, 0.1], "make one band more"),
        (("miss", "by_distance"), [0, 0, 0, 0, 0, 0, 1.2], "less than or equal to 1"),
        (("score", "true"), [0.5, 0.4], "does not ascend"),
        (("false_positive", "on_furniture"), -0.1, "greater than or equal to 0"),
        (("scale", "miss"), -1, "greater than or equal to 0"),
        (("confusion", "row"), {"mug": {"cup": 0.1}}, "it is the same"),
        (("confusion", "row"), {"mug": {"can": 0.9}}, "is confused with probability"),
        (("mask", "partial"), 0.95, "more than all"),
        (("mask", "surprise"), 1, "Extra inputs"),
    ],
)
def test_an_invalid_table_is_refused_with_the_cause(where, value, said):
    data = TABLE.file.model_dump()
    data[where[0]][where[1]] = value
    with pytest.raises(ValueError, match=said):
        view_table(data, "")


def test_an_invalid_file_level_or_correlation_is_refused(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('format = "views"\nname = "mine"\n')
    with pytest.raises(InvalidInput, match=r"ovmm-v1\.toml"):
        load_noise(str(path))
    with pytest.raises(InvalidInput, match="0 to 10"):
        TABLE.scaled(11)
    with pytest.raises(InvalidInput, match="correlation"):
        TABLE.scaled(1, -0.1)
