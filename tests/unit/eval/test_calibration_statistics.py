"""Tests the calibration statistics against hand-computed and simulated cases."""

import numpy as np
import pytest
from helios_eval.calibration import statistics as st
from hypothesis import given, settings
from hypothesis import strategies as some
from hypothesis.extra import numpy as arrays

TEN = st.equal_width_edges(10)
FOUR = np.array([0.1, 0.4, 0.35, 0.8])
FOUR_TRUE = np.array([False, False, True, True])

scores = arrays.arrays(np.float64, some.integers(2, 40), elements=some.floats(-0.5, 1.0))


@some.composite
def judged(draw):
    score = draw(scores)
    truth = draw(arrays.arrays(np.bool_, len(score)))
    return score, truth


def drawn(n: int, seed: int, wrong_by: float = 0.0) -> tuple[st.Scores, st.Truths]:
    """Scores 0.1 to 0.9 whose truth is drawn with probability score - wrong_by."""
    rng = np.random.default_rng(seed)
    score = rng.uniform(0.1, 0.9, n)
    return score, rng.random(n) < score - wrong_by


# --- by hand ---------------------------------------------------------------------------------
def test_ece_of_two_bins_equals_the_hand_computed_value():
    score = np.array([0.2, 0.2, 0.9, 0.9])
    truth = np.array([False, True, True, True])
    # Bin of 0.2: half is true, gap 0.3; bin of 0.9: all is true, gap 0.1; each weighs one half.
    assert st.ece(score, truth, TEN)[0] == pytest.approx(0.2)
    bins = st.reliability(score, truth, TEN)
    assert bins.count.tolist() == [2, 2]
    assert bins.score == pytest.approx([0.2, 0.9])
    assert bins.true == pytest.approx([0.5, 1.0])
    assert st.mce(bins) == pytest.approx(0.3)


def test_auroc_equals_the_hand_computed_value():
    assert st.auroc(FOUR, FOUR_TRUE)[0] == pytest.approx(0.75)  # three of four pairs
    assert st.auroc(np.full(4, 0.5), FOUR_TRUE)[0] == pytest.approx(0.5)  # ties count half
    assert np.isnan(st.auroc(FOUR, np.ones(4, bool))[0])


def test_brier_score_and_its_parts_equal_the_hand_computed_values():
    score = np.array([0.2, 0.2, 0.9, 0.9])
    truth = np.array([False, True, True, True])
    b = st.brier(score, truth, TEN)
    assert b.total == pytest.approx((0.04 + 0.64 + 0.01 + 0.01) / 4)
    assert b.reliability == pytest.approx((0.09 + 0.01) / 2)
    assert b.resolution == pytest.approx(0.0625)
    assert b.uncertainty == pytest.approx(0.1875)
    assert b.within == pytest.approx(0.0, abs=1e-12)  # scores are equal within each bin


def test_wilson_bounds_equal_the_hand_computed_values():
    low, high = st.wilson(np.array([0, 5, 10]), np.array([10, 10, 10]))
    assert low == pytest.approx([0.0, 0.2366, 0.7225], abs=1e-4)
    assert high == pytest.approx([0.2775, 0.7634, 1.0], abs=1e-4)


def test_edges_and_out_of_range_scores_fall_into_a_bin():
    at = st.bin_of(np.array([-0.3, 0.0, 0.1, 0.99, 1.0, 1.2]), TEN)
    assert at.tolist() == [0, 0, 1, 9, 9, 9]


def test_adaptive_bins_hold_equal_counts():
    score = np.random.default_rng(0).random(1000) ** 3
    bins = st.reliability(score, score > 0.5, st.equal_count_edges(score, 10))
    assert bins.count.tolist() == [100] * 10


def test_equal_scores_share_one_adaptive_bin():
    score = np.full(7, 0.3)
    bins = st.reliability(score, np.ones(7, bool), st.equal_count_edges(score))
    assert bins.count.tolist() == [7]


# --- simulated -------------------------------------------------------------------------------
def test_a_calibrated_score_has_an_ece_within_chance():
    score, truth = drawn(20_000, seed=1)
    found = st.ece(score, truth, TEN)[0]
    mean, most = st.ece_if_calibrated(score, TEN, 200, np.random.default_rng(2))
    assert found < 0.02
    assert 0.3 * mean < found < 1.5 * most


def test_the_ece_of_an_overconfident_score_is_its_overconfidence():
    score, truth = drawn(20_000, seed=3, wrong_by=0.1)
    assert st.ece(score, truth, TEN)[0] == pytest.approx(0.1, abs=0.01)
    assert st.ece(score, truth, st.equal_count_edges(score))[0] == pytest.approx(0.1, abs=0.01)
    assert st.ece_if_calibrated(score, TEN, 100, np.random.default_rng(0))[1] < 0.02


def test_a_random_score_has_auroc_one_half_and_no_resolution():
    rng = np.random.default_rng(4)
    score, truth = rng.random(20_000), rng.random(20_000) < 0.3
    assert st.auroc(score, truth)[0] == pytest.approx(0.5, abs=0.015)
    assert st.brier(score, truth, TEN).resolution < 0.001


def test_dependent_beliefs_widen_the_interval():
    """Ten copies of a belief in one episode are no more evidence than one."""
    score, truth = drawn(200, seed=5, wrong_by=0.1)
    score, truth = np.repeat(score, 10), np.repeat(truth, 10)
    rng = np.random.default_rng(6)

    def width(episode: np.ndarray) -> float:
        low, high = st.percentile_interval(
            st.bootstrap(lambda w: st.auroc(score, truth, w), episode, 400, rng)
        )
        return high - low

    together, apart = width(np.repeat(np.arange(200), 10)), width(np.arange(2000))
    assert together == pytest.approx(apart * np.sqrt(10), rel=0.25)


def test_the_bootstrap_interval_covers_the_truth_at_about_its_nominal_rate():
    held = 0
    for seed in range(40):
        score, truth = drawn(600, seed=100 + seed, wrong_by=0.1)
        drawn_eces = st.bootstrap(
            lambda w, s=score, t=truth: st.ece(s, t, TEN, w),
            np.repeat(np.arange(60), 10),
            200,
            np.random.default_rng(seed),
        )
        low, high = st.percentile_interval(drawn_eces)
        held += low <= 0.1 <= high
    assert held >= 33


# --- always ----------------------------------------------------------------------------------
@settings(deadline=None)
@given(judged())
def test_auroc_of_the_negated_score_is_one_minus_auroc(case):
    score, truth = case
    forward, backward = st.auroc(score, truth)[0], st.auroc(-score, truth)[0]
    assert (np.isnan(forward) and np.isnan(backward)) or forward + backward == pytest.approx(1.0)


@settings(deadline=None)
@given(judged())
def test_auroc_is_the_share_of_correctly_ordered_pairs(case):
    score, truth = case
    right, wrong = score[truth], score[~truth]
    if len(right) and len(wrong):
        pairs = (right[:, None] > wrong) + 0.5 * (right[:, None] == wrong)
        assert st.auroc(score, truth)[0] == pytest.approx(pairs.mean())


@settings(deadline=None)
@given(judged())
def test_the_parts_of_the_brier_score_sum_to_the_total_and_are_not_negative(case):
    score, truth = case
    b = st.brier(score, truth, TEN)
    assert b.total == pytest.approx(b.reliability - b.resolution + b.uncertainty + b.within)
    assert min(b.total, b.reliability, b.resolution, b.uncertainty) >= -1e-12


@settings(deadline=None)
@given(judged())
def test_ece_is_the_weighted_mean_gap_and_at_most_mce(case):
    score, truth = case
    bins = st.reliability(score, truth, TEN)
    by_bins = float((bins.count * bins.gap).sum() / bins.count.sum())
    assert st.ece(score, truth, TEN)[0] == pytest.approx(by_bins)
    assert by_bins <= st.mce(bins) + 1e-12
    assert (bins.true_low <= bins.true + 1e-12).all()
    assert (bins.true <= bins.true_high + 1e-12).all()


@settings(deadline=None)
@given(judged(), some.integers(0, 3))
def test_an_integer_weight_equals_that_many_copies(case, times):
    score, truth = case
    weight = np.ones((1, len(score)))
    weight[0, 0] += times
    copied = np.r_[score, np.repeat(score[:1], times)], np.r_[truth, np.repeat(truth[:1], times)]
    assert st.ece(score, truth, TEN, weight)[0] == pytest.approx(st.ece(*copied, TEN)[0])
    np.testing.assert_allclose(st.auroc(score, truth, weight), st.auroc(*copied), equal_nan=True)
