"""Tests the published figures, and the choice of the runs that are compared with them."""

from __future__ import annotations

import hashlib
import math

import pytest
from helios_eval.report import paper_comparison, paper_figures, record_metrics
from helios_eval.report.agent_groups import arms_of, in_common, pairs, plain_arm, swept_arm
from helios_eval.report.interval_statistics import Interval
from helios_eval.report.paper_comparison import relations, verdict_of
from helios_eval.report.report_model import Table
from helios_eval.studies.noise_severity import WANTED
from helios_planner.task import Cause
from synthetic_episodes import NOISE, episode

TABLES = (
    paper_figures.TABLE_1,
    paper_figures.TABLE_2,
    paper_figures.TABLE_4,
    paper_figures.TABLE_5,
    *paper_figures.SWEEPS,
)


def test_published_figures_match_the_paper():
    rows = {(t.number, r.group, r.name): r.figures for t in TABLES for r in t.rows}
    assert str(rows[1, "unlimited picks", "HELIOS"]["SR"]) == "3.2 ± 0.5"
    assert str(rows[1, "1 pick", "Trusting agent"]["FindObj"]) == "13.7 ± 1.0"
    assert str(rows[4, "", "HELIOS with ground truth"]["Place"]) == "29.8 ± 1.3"
    assert str(rows[2, "", "VLFM"]["SPL"]) == "30.4"
    assert "Place" not in rows[1, "other work", "MoManipVLA"]
    assert [len(t.rows) for t in TABLES] == [14, 3, 6, 6, 11, 11, 11]
    # Digest of all figures; they were compared with the paper's tables one by one.
    texts = [f"{key} {name} {figure}" for key, r in rows.items() for name, figure in r.items()]
    assert hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16] == "710ad7b8a054a420"


def test_relations_leave_out_what_the_noise_was_tuned_on():
    by_metric = {(r.metric, r.claim): round(r.published, 2) for r in paper_figures.RELATIONS}
    noisy = "trusting agent, noisy over ground-truth semantics"
    assert {metric for metric, claim in by_metric if claim == noisy} == {"FindRec", "SR"}
    assert not WANTED.keys() & {"find_receptacle", "success"}
    assert by_metric["FindRec", noisy] == 0.24
    assert by_metric["SR", noisy] == 0.14
    assert by_metric["SR", "HELIOS over the trusting agent"] == 1.78


def test_more_picks_than_the_limit_score_zero():
    lucky = episode(1, picks=6, find_object=True, pick=True, success=True, steps=80, collisions=2)
    assert record_metrics.value(lucky, "SR") == 1
    assert record_metrics.value(lucky, "SR", picks=6) == 1
    assert record_metrics.value(lucky, "SR", picks=5) == 0
    assert record_metrics.value(lucky, "partial", picks=5) == 0
    assert record_metrics.value(lucky, "steps", picks=5) == 80
    assert record_metrics.value(lucky, "collisions", picks=5) == 2


def lost(seed: int, agent: str = "helios-paper", **changes):
    """Episode that could not be played, as the runner records it."""
    nothing = {"steps": 0, "collisions": 0, "collided_with": (), "step_ms": 0.0, "path_m": 0.0,
               "picks": 0, "find_object": False, "pick": False, "find_receptacle": False,
               "place": False, "success": False, "cause": "system error", "structure_hash": "",
               "instruction": "", "object_class": ""}  # fmt: skip
    return episode(seed, agent, **(nothing | changes))


@pytest.mark.parametrize("name", ["steps", "collisions", "seconds_per_step"])
def test_an_episode_that_was_not_played_lowers_the_success_and_no_other_mean(name):
    played = [episode(s, steps=100 + s, collisions=1, success=True) for s in range(4)]
    records = [*played, lost(4), lost(5)]
    assert list(record_metrics.values(records, name)) == list(record_metrics.values(played, name))
    assert record_metrics.values(records, "SR").mean() == 4 / 6


def test_a_pair_leaves_out_the_home_that_either_agent_did_not_play():
    mine = [episode(0, steps=10), lost(1), episode(2, steps=30)]
    theirs = [episode(s, "trusting", steps=5) for s in range(2)] + [lost(2, "trusting")]
    x, y = record_metrics.paired_values(mine, theirs, "steps")
    assert (list(x), list(y)) == ([10], [5])
    x, y = record_metrics.paired_values(mine, theirs, "SR")
    assert len(x) == len(y) == 3
    x, y = record_metrics.paired_values(mine[1:2], theirs[1:2], "steps")
    assert len(x) == len(y) == 0


def cells(table: Table, name: str) -> list[str]:
    return [c.text for row in table.rows if row.cells[0].text == name for c in row.cells]


def tables(episodes) -> dict[str, Table]:
    section = paper_comparison.section(arms_of(episodes))
    assert section is not None
    return {b.title.partition(":")[0]: b for b in section.blocks if isinstance(b, Table)}


def test_agents_without_a_run_are_marked_and_other_work_shows_only_the_papers_figures():
    table = tables([episode(s, "helios-paper") for s in range(4)])["Table 4"]
    assert cells(table, "Trusting agent with ground truth")[1] == "not run"
    assert cells(table, "MoManipVLA")[1] == "paper 23.7"
    assert cells(table, "HELIOS")[-1] == "4"
    assert all(t.tag == "another simulator" for t in (table,))


def test_sweeps_appear_only_when_they_were_run():
    plain = [episode(s, "helios-paper") for s in range(4)]
    assert not tables(plain).keys() & {"Table 5", "Table 6"}
    swept = [episode(s, "helios-paper", settings={"planner.tau_g": 0.3}) for s in range(3)]
    found = tables([*plain, *swept])
    assert cells(found["Table 8"], "τ_g = 0.3")[-1] == "3"
    assert cells(found["Table 8"], "τ_g = 0.5")[-1] == "4"
    assert cells(found["Table 8"], "τ_g = 0.7")[1] == "not run"
    assert "Table 5" in tables([*plain, episode(0, "helios-5050")])


def test_an_arm_with_another_noise_does_not_enter_a_table():
    louder = NOISE.model_copy(update={"level": 2.0})
    arms = arms_of(
        [
            episode(0, "helios-paper"),
            episode(1, "helios-paper"),
            episode(0, "trusting", noise=louder),
        ]
    )
    assert plain_arm(arms, "ovmm", "helios-paper", "noisy") is not None
    assert plain_arm(arms, "ovmm", "trusting", "noisy") is None


def test_labels_name_only_the_differences():
    louder = NOISE.model_copy(update={"level": 2.0})
    one = arms_of([episode(0, "helios-paper"), episode(0, "trusting")])
    assert [a.label for a in one] == ["helios-paper", "trusting"]
    many = arms_of(
        [
            episode(0, "helios-paper"),
            episode(0, "helios-paper", noise=louder),
            episode(0, "helios-paper", settings={"a": 1}),
            episode(0, "helios-paper", semantics="ground-truth"),
        ]
    )
    assert {a.label for a in many} == {
        "helios-paper",
        "helios-paper · noise ×2",
        "helios-paper · a=1",
        "helios-paper · ground truth",
    }


def test_a_swept_arm_differs_in_only_the_swept_setting():
    far, both = {"planner.alpha_d": 0.01}, {"planner.alpha_d": 0.01, "planner.tau_g": 0.3}
    arms = arms_of([episode(0), episode(0, settings=far), episode(0, settings=both)])
    base = plain_arm(arms, "ovmm", "helios-paper", "noisy")
    assert base is not None
    found = swept_arm(arms, base, "alpha_d", 0.01)
    assert found is not None
    assert dict(found.settings) == {"planner.alpha_d": 0.01}
    assert swept_arm(arms, base, "tau_g", 0.3) is None


def test_pairs_put_the_new_agent_first_and_compare_within_a_condition():
    agents = ("helios-paper", "trusting", "helios")
    arms = arms_of([episode(0, a, semantics=s) for a in agents for s in ("noisy", "ground-truth")])
    names = {(a.label, b.label) for a, b in pairs(arms)}
    assert ("helios-paper", "trusting") in names
    assert ("helios", "helios-paper") in names
    assert ("helios-paper · ground truth", "trusting · ground truth") in names
    assert ("helios-paper · ground truth", "helios-paper") in names
    assert ("helios-paper", "trusting · ground truth") not in names


def test_an_episode_that_never_began_still_counts_against_its_agent():
    lost = episode(1, "trusting", structure_hash="", steps=0, cause="system error")
    elsewhere = episode(2, "trusting", structure_hash="another home")
    arms = arms_of([*(episode(s) for s in range(4)), episode(0, "trusting"), lost, elsewhere])
    mine, theirs = in_common(*arms)
    assert [r.seed for r in mine] == [r.seed for r in theirs] == [0, 1]


def test_pairs_leave_out_homes_with_another_task():
    other = episode(1, "trusting", object_class="vase")
    arms = arms_of([episode(0), episode(1), episode(0, "trusting"), other])
    mine, theirs = in_common(*arms)
    assert [r.seed for r in mine] == [r.seed for r in theirs] == [0]


def test_arms_with_another_camera_error_or_step_limit_are_not_held_together():
    for settings in ({"sensor": "realistic"}, {"max_steps": 20}):
        arms = arms_of([episode(0, settings=settings), episode(0, "trusting")])
        assert arms[0].condition != arms[1].condition
        assert pairs(arms) == []


def test_pairs_use_only_homes_that_both_agents_played():
    arms = arms_of([*(episode(s) for s in range(4)), *(episode(s, "trusting") for s in (2, 3, 5))])
    mine, theirs = in_common(*arms)
    assert [r.seed for r in mine] == [r.seed for r in theirs] == [2, 3]


def test_every_failure_cause_has_its_own_colour():
    from helios_eval.report import colors

    assert {*colors.CAUSES, Cause.UNREACHABLE} == {c.value for c in Cause}
    assert (
        len({colors.of_cause(c).light for c in ("", *colors.CAUSES, "unknown")})
        == len(colors.CAUSES) + 2
    )


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (2.0, 3.0, "larger here"),
        (0.5, 0.9, "smaller here"),
        (0.5, 2.0, "lies in our interval"),
        (1.0, math.inf, "lies in our interval"),
        (2.0, math.inf, "larger here"),
        (math.nan, math.nan, ""),
    ],
)
def test_the_verdict_on_a_published_ratio_follows_the_interval(low, high, words):
    verdict = verdict_of(Interval(1.0, low, high), published=1.0)
    assert words in verdict
    assert bool(words) == bool(verdict)


@pytest.mark.parametrize("homes", [1, 3, 5])
@pytest.mark.parametrize("won", [True, False])
def test_few_homes_never_give_a_verdict(homes, won):
    """With one home each and two successes the ratio is 1 and the bootstrap interval [1, 1], which
    does not contain the paper's 1.93."""
    met = {"find_object": won, "pick": won, "success": won, "place": won}
    arms = arms_of(
        [episode(s, a, **met) for s in range(homes) for a in ("helios-paper", "trusting")]
    )
    table = relations(arms)
    assert table is not None
    assert {row.cells[-1].text for row in table.rows} == {"too few homes to tell"}
    assert not any("[" in cell.note for row in table.rows for cell in row.cells)


def test_homes_without_any_difference_give_no_verdict():
    arms = arms_of(
        [
            episode(s, a, find_object=True, pick=True, success=True)
            for s in range(20)
            for a in ("helios-paper", "trusting")
        ]
    )
    table = relations(arms)
    assert table is not None
    assert {row.cells[-1].text for row in table.rows} == {"no home differs"}


HOMES = range(20)
TRUTH = {"semantics": "ground-truth"}
OVMM = {"pick_rule": "ovmm"}


def names(episodes) -> set[str]:
    table = relations(arms_of(episodes))
    return {row.cells[0].text for row in table.rows} if table else set()


def test_relations_leave_out_arms_of_another_pick_rule():
    noisy = [episode(s) for s in HOMES]
    other = [episode(s, settings=OVMM, **TRUTH) for s in HOMES]
    assert names([*noisy, *other]) == set()
    same = [episode(s, **TRUTH) for s in range(6)]
    table = relations(arms_of([*noisy, *other, *same]))
    assert table is not None
    assert {row.cells[3].text for row in table.rows} == {"6"}


def test_relations_leave_out_arms_with_other_settings():
    changed = [episode(s, settings={"planner.alpha_d": 9}) for s in HOMES]
    plain = [episode(s, "trusting") for s in HOMES]
    assert names([*changed, *plain]) == set()
    assert names([*(episode(s) for s in HOMES), *changed, *plain]) == {
        f"{metric}: HELIOS over the trusting agent" for metric in ("FindObj", "Pick", "SR")
    }


def test_a_table_of_the_paper_leaves_out_arms_with_other_settings_and_says_so():
    changed = [episode(s, settings={"planner.alpha_d": 9}) for s in range(4)]
    found = tables([*changed, *(episode(s, "trusting") for s in range(4))])["Table 1"]
    row = next(r for r in found.rows if r.cells[0].text == "HELIOS")
    assert row.cells[1].text == "not run"
    assert "Left out" in found.caption
    assert "helios-paper" in found.caption
    alone = tables(changed)["Table 1"]
    assert "Ours with planner.alpha_d=9." in alone.caption


def test_an_arm_with_another_value_of_a_setting_is_not_the_row_of_the_papers_value():
    found = tables([episode(s, settings={"planner.tau_g": t}) for s in range(3) for t in (0.3, 9)])
    table = found["Table 8"]
    assert cells(table, "τ_g = 0.3")[-1] == "3"
    assert cells(table, "τ_g = 0.5")[1] == "not run"
