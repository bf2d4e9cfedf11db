"""Tests the calibration report: samples, groups and figures from episode records."""

import json

import cv2
import numpy as np
import pytest
from eval_constructed_records import belief, episodes, record
from helios_core.errors import InvalidInput
from helios_eval.calibration import figures
from helios_eval.calibration.command import calibration
from helios_eval.calibration.report import markdown_table
from helios_eval.calibration.samples import VIEWS, by_setting, samples_of
from helios_eval.calibration.summary import ALL, rows_of
from helios_eval.episodes.episode_record import Noise, append

CORRELATED = Noise(table="ovmm-v1", digest="0", level=2.0, correlation=1.0)


@pytest.fixture(scope="module")
def calibration_figures():
    calm, wild = episodes(30), episodes(30, overconfident=0.3, noise=CORRELATED)
    return figures([*calm, *wild])


def test_the_last_belief_of_each_instance_counts():
    beliefs = (
        belief(1, False, step=20),
        belief(2, True, step=20),
        belief(1, True, 0.9, step=40),
        belief(3, False, step=60),
        belief(3, True, 0.8, step=60),
    )
    reported = record(0, beliefs)
    samples = samples_of([reported, record(1, beliefs[:1])])
    assert samples.class_score.tolist() == [0.9, 0.6, 0.8, 0.6]
    assert samples.correct.tolist() == [True, True, True, False]
    assert samples.episode.tolist() == [0, 0, 0, 1]
    assert len(samples_of([reported], every_step=True)) == 5


def test_every_number_of_views_belongs_to_one_group():
    beliefs = tuple(belief(k, True, views=k) for k in range(30))
    samples = samples_of([record(0, beliefs)])
    assert [len(samples.of_views(name)) for name, _, _ in VIEWS] == [2, 2, 4, 22]


def test_samples_are_selected_by_role():
    roles = ("object", "start", "goal")
    samples = samples_of([record(0, tuple(belief(k, True, role=r) for k, r in enumerate(roles)))])
    assert len(samples.of_role("object")) == 1
    assert len(samples.of_role("receptacle")) == 2


def test_settings_are_named_by_noise_and_by_their_differences():
    one = (belief(1, True),)
    table = Noise(table="other", digest="1", level=1.0, correlation=None)
    groups = by_setting(
        [
            record(0, one),
            record(1, one, noise=CORRELATED),
            record(2, one, semantics="ground-truth", noise=None),
            record(3),
        ]
    )
    assert list(groups) == [
        "ground truth",
        "noise ×1, correlation of the table",
        "noise ×2, correlation 1",
    ]
    assert [r.seed for rs in groups.values() for r in rs] == [2, 0, 1]
    groups = by_setting(
        [
            record(0, one),
            record(0, one, agent="no-objective"),
            record(0, one, noise=table),
            record(0, one, settings={"objectmap.prior": 2.0}),
        ]
    )
    assert len(groups) == 4
    assert "noise ×1, no-objective, table ovmm-v1, objectmap.prior=default" in groups
    assert "noise ×1, helios-paper, table ovmm-v1, objectmap.prior=2.0" in groups


def test_rows_distinguish_a_calibrated_setting_from_an_overconfident_one():
    groups = {"calm": samples_of(episodes(60)), "wild": samples_of(episodes(60, 0.3))}
    rows = {(r.setting, r.role, r.views, r.score): r for r in rows_of(groups)}
    for role in ("object", "receptacle"):
        calm, wild = rows["calm", role, ALL, "S"], rows["wild", role, ALL, "S"]
        assert calm.ece < 1.5 * calm.ece_by_chance
        assert wild.ece == pytest.approx(0.25, abs=0.08)
        assert wild.ece_low > wild.ece_by_chance
        assert wild.ece_low <= wild.ece <= wild.ece_high
        assert calm.auroc_low <= calm.auroc <= calm.auroc_high
    uncertainty = rows["calm", "object", ALL, "−U"]
    assert np.isnan(uncertainty.ece)  # −U is no probability
    assert 0.5 < uncertainty.auroc < 1.0
    assert uncertainty.cells()["ece"] is None


def test_small_groups_are_left_out_and_figures_need_beliefs():
    assert figures([record(0), record(1)]) == []
    assert figures([record(0, (belief(1, True), belief(2, False)))]) == []


def test_a_setting_with_small_view_groups_has_no_figure_by_views():
    beliefs = tuple(belief(k, k % 3 > 0, views=1 + k) for k in range(24))
    assert [f.title.split(":")[0] for f in figures([record(0, beliefs)])] == ["Reliability"]


def test_beliefs_that_are_all_correct_give_a_figure_without_auroc():
    reported = [
        record(k, tuple(belief(i, True, 0.5 + i / 50) for i in range(20))) for k in range(3)
    ]
    first, _ = figures(reported)
    assert all(row["auroc"] is None for row in first.table)


def test_fewer_than_six_episodes_have_no_interval():
    """A bootstrap over one episode always draws the same: an interval without width."""
    few, enough = (rows_of({"": samples_of(episodes(count))}) for count in (5, 6))
    assert few
    assert all(np.isnan([r.ece_low, r.ece_high, r.auroc_low, r.auroc_high]).all() for r in few)
    assert all(np.isfinite(r.ece_low) for r in enough if r.score != "−U")
    first, *_ = figures(episodes(5))
    assert "5 episodes are too few" in first.caption
    assert first.table[0]["ece_low"] is None


def test_more_beliefs_of_the_same_homes_make_no_interval_narrower():
    """Beliefs of one home depend on each other, so the bootstrap draws whole episodes."""

    def rows(copies: int):
        reported = [
            record(k, tuple(belief(i, k % 3 > 0, 0.3 + 0.02 * k) for i in range(copies)))
            for k in range(24)
        ]
        return [r for r in rows_of({"": samples_of(reported)}) if r.views == ALL]

    for once, thrice in zip(rows(1), rows(3), strict=True):
        assert (once.samples, thrice.samples) == (24, 72)
        first, second = ([r.ece_low, r.ece_high, r.auroc_low, r.auroc_high] for r in (once, thrice))
        np.testing.assert_allclose(first, second, equal_nan=True)


def test_figures_have_an_image_a_caption_and_a_table(calibration_figures):
    assert [f.title.split(":")[0] for f in calibration_figures] == [
        "Calibration by the detector's noise",
        *["Reliability", "What more views bring"] * 2,
    ]
    for figure in calibration_figures:
        picture = cv2.imdecode(np.frombuffer(figure.png, np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        assert picture.shape[1] >= 1000
        assert figure.caption
        assert {"setting", "ece", "auroc", "samples"} <= figure.table[0].keys()
        json.dumps(figure.table, allow_nan=False)


def test_the_same_records_give_the_same_numbers(calibration_figures):
    again = figures([*episodes(30), *episodes(30, overconfident=0.3, noise=CORRELATED)])
    assert [f.table for f in again] == [f.table for f in calibration_figures]


def test_the_command_compares_folders(tmp_path, capsys):
    folders = [tmp_path / "calm", tmp_path / "wild"]
    runs = episodes(12), episodes(12, noise=CORRELATED)
    for folder, reported in zip(folders, runs, strict=True):
        folder.mkdir()
        for one in reported:
            append(folder, one)
    calibration(folders, tmp_path / "out")
    text = (tmp_path / "out" / "calibration.md").read_text()
    assert str(tmp_path / "out" / "calibration.md") in capsys.readouterr().out
    assert "noise ×2, correlation 1" in text
    assert "nan" not in text
    pictures = sorted(p.name for p in (tmp_path / "out").glob("*.png"))
    assert len(pictures) == 5
    assert all(f"({name})" in text for name in pictures)
    assert len(json.loads((tmp_path / "out" / "calibration.json").read_text())) == 5


def test_wrong_folders_are_refused(tmp_path):
    with pytest.raises(InvalidInput, match="holds no episodes"):
        calibration([tmp_path], tmp_path / "out")
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        append(tmp_path / name, record(7, (belief(1, True),)))
    with pytest.raises(InvalidInput, match="seed 7 of helios-paper lies in"):
        calibration([tmp_path / "a", tmp_path / "b"], tmp_path / "out")
    with pytest.raises(InvalidInput, match="no group has 20 beliefs"):
        calibration([tmp_path / "a"], tmp_path / "out")


def test_special_characters_in_cells_do_not_break_a_markdown_table():
    table = markdown_table([{"name": "a|b\nc", "x": 0.12345, "none": None}])
    assert table.splitlines()[2] == "| a\\|b c | 0.123 | – |"
