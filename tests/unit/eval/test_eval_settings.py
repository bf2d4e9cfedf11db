"""Tests service settings by name, agents and presets."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import pytest
from helios_client.usage_errors import UsageError
from helios_core.agent_presets import AGENT_SETTINGS
from helios_detector.simulation.frame_noise import load_noise
from helios_eval.episodes import episode_player, episode_spec, home_presets, service_settings
from helios_eval.episodes.episode_record import Benchmark, Setting
from helios_eval.episodes.run_conditions import Condition, parse_condition
from helios_planner.agents import AGENTS
from helios_planner.settings import Settings


def test_a_setting_is_found_by_its_name_and_keeps_its_type() -> None:
    found = service_settings.parsed(
        ["alpha_d=0.01", "planner.margins_m=0.1,0.2", "gain_norm=sum", "map2d.cell_m=0.05"]
    )
    assert found == {
        "planner.alpha_d": 0.01,
        "planner.margins_m": "0.1,0.2",
        "planner.gain_norm": "sum",
        "map2d.cell_m": 0.05,
    }
    assert service_settings.of_service("planner", found) == {
        "alpha_d": 0.01,
        "margins_m": (0.1, 0.2),
        "gain_norm": "sum",
    }


def test_a_tuple_has_one_text_however_it_is_typed() -> None:
    """Else equal episodes would count as two arms."""
    for typed in ("0.1,0.05", "0.10, 0.05", " .1 ,5e-2"):
        assert service_settings.parsed([f"margins_m={typed}"]) == {"planner.margins_m": "0.1,0.05"}


def test_none_is_a_word_unless_the_setting_may_be_nothing() -> None:
    found = service_settings.parsed(["landmarks=none", "detector.depth=none", "floor_m=none"])
    assert service_settings.of_service("detector", found) == {"landmarks": "none", "depth": "none"}
    assert service_settings.of_service("objectmap", found) == {"floor_m": None}


def test_a_default_value_does_not_count_as_a_setting() -> None:
    """An episode with the default set explicitly equals one without."""
    found = service_settings.parsed(["alpha_d=0.001", "margins_m=0.08,0.05,0.025", "tau_g=0.6"])
    defaults = Settings()
    found["planner.margins_m"] = ",".join(map(str, defaults.margins_m))
    assert service_settings.differing_settings("helios-paper", found) == {"planner.tau_g": 0.6}


def test_a_value_of_the_agents_preset_is_no_override_but_a_default_is() -> None:
    found = service_settings.parsed(["evidence=hindsight", "tau_b=0.5"])
    assert service_settings.differing_settings("helios", found) == {"planner.tau_b": 0.5}
    assert service_settings.differing_settings("helios-paper", found) == {
        "objectmap.evidence": "hindsight"
    }


def test_a_finished_run_is_compared_by_the_settings_it_ran_with() -> None:
    ran = {"planner.tau_g": "0.6", "planner.margins_m": str((0.1, 0.2))}
    given = {"planner.tau_g": 0.6, "planner.margins_m": "0.1,0.2", "planner.tau_b": 0.5}
    assert service_settings.differing_settings("helios-paper", given, ran) == {}
    assert service_settings.differing_settings("helios-paper", {"planner.tau_g": 0.5}, ran)


def test_an_unknown_or_invalid_setting_counts_as_an_override() -> None:
    given = {"planner.gone": 1, "gone.tau_g": 0.5, "planner.alpha_d": -1.0}
    assert service_settings.differing_settings("helios-paper", given) == given


@pytest.mark.parametrize("agent", sorted(AGENTS))
def test_an_episode_runs_with_the_settings_of_the_running_services(agent: str) -> None:
    """An evaluated service differs from one of `helios up --agent` in no setting that decides."""
    decides = service_settings.default_settings_of(agent)
    of_episode = service_settings.of_stack(agent, {})
    for service, settings in service_settings.SERVICES.items():
        running = settings.load(["--agent", agent] if "agent" in settings.model_fields else [])
        built = settings(**service_settings.of_service(service, of_episode))
        names = [n for n in settings.model_fields if f"{service}.{n}" in decides]
        assert names
        assert {n: getattr(built, n) for n in names} == {n: getattr(running, n) for n in names}


def test_every_setting_of_an_agent_belongs_to_a_service() -> None:
    for agent, settings in AGENT_SETTINGS.items():
        assert agent in AGENTS
        named = [f"{name}={value}" for name, value in settings.items()]
        assert service_settings.parsed(named) == settings


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("alpha_d", "name=value"),
        ("=1", "name=value"),
        ("nonsense=1", "no service has"),
        ("nonsense=1", "helios_objectmap"),
        ("alpha_dd=1", "did you mean planner.alpha_d or"),
        ("alpha_dd", "planner.alpha_d"),
        ("max_dept_m=3", "objectmap.max_depth_m or map2d."),
        ("planner.tua_g=1", "planner.tau_g"),
        ("alpha_d=-1", "alpha_d"),
        ("gain_norm=most", "per_gaussian"),
        ("max_depth_m=3", "objectmap.max_depth_m"),
        ("planner.state_dir=/tmp", "no service has"),
    ],
)
def test_an_invalid_setting_is_a_usage_error(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        service_settings.parsed([text])


def test_unknown_agents_and_presets_are_usage_errors() -> None:
    episode_spec.check_agents(["helios-paper", "ground-truth-walker"], "ovmm")
    home_presets.check_kind("demo-v1")
    with pytest.raises(UsageError, match="helios-paper"):
        episode_spec.check_agents(["hal"], "ovmm")
    with pytest.raises(UsageError, match="walker"):
        episode_spec.check_agents(["ground-truth-walker"], "objectnav")
    with pytest.raises(UsageError, match="demo-v1"):
        home_presets.check_kind("palace")


def test_names_are_accepted_in_any_case_and_deduplicated() -> None:
    assert episode_spec.check_agents(["HELIOS-Paper", "helios-paper", "Trusting"], "ovmm") == [
        "helios-paper",
        "trusting",
    ]
    assert home_presets.check_kind("Demo_V1") == "demo-v1"
    under = parse_condition(
        ["Helios-Paper"], "ovmm", semantics="Ground-Truth", preset="DEMO-v1", table=None, level=1.0,
        correlation=None, sensor="none", assignments=[], max_steps=None,
        scorer=None,
    )  # fmt: skip
    assert (under.agents, under.semantics, under.preset) == (
        ("helios-paper",),
        "ground-truth",
        "demo-v1",
    )


@pytest.mark.parametrize(
    ("flag", "assignments", "scorer"),
    [
        (None, [], episode_spec.DEFAULT_SCORER),
        (None, ["scorer=minilm"], "minilm"),
        ("lexical", [], "lexical"),
        ("lexical", ["detector.scorer=minilm"], "lexical"),
    ],
)
def test_episodes_record_the_scorer_that_the_flag_or_the_setting_names(
    flag: str | None, assignments: list[str], scorer: str
) -> None:
    under = parse_condition(
        ["vlfm"], "objectnav", semantics="noisy", preset="demo-v1", table=None, level=1.0,
        correlation=None, sensor="none", assignments=assignments, max_steps=None, scorer=flag,
    )  # fmt: skip
    kept = service_settings.differing_settings("vlfm", under.settings)
    assert episode_spec.scorer_of(kept) == scorer


def with_pick_rule(rule: str, benchmark: str = "ovmm") -> Condition:
    return parse_condition(
        ["helios"], benchmark, semantics="noisy", preset="demo-v1", table=None, level=1.0,
        correlation=None, sensor="none", assignments=[], max_steps=None, scorer=None,
        pick_rule=rule,
    )  # fmt: skip


def test_episodes_record_a_pick_rule_other_than_the_default() -> None:
    plain, ovmm = with_pick_rule("physical"), with_pick_rule("OVMM")
    assert "pick_rule" not in plain.settings
    assert ovmm.settings == {**plain.settings, "pick_rule": "ovmm"}
    kept = service_settings.differing_settings("helios", ovmm.settings)
    assert kept["pick_rule"] == "ovmm"
    spec = episode_spec.EpisodeSpec("ovmm", "helios", "noisy", "demo-v1", 0, None, kept)
    assert spec.pick_rule == "ovmm"
    assert replace(spec, settings=plain.settings).pick_rule == "physical"


def test_the_world_of_an_episode_has_its_pick_rule(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[str] = []

    def world(*_: object, pick_rule: str, **__: object) -> None:
        given.append(pick_rule)

    monkeypatch.setattr(episode_player, "TimedWorld", world)
    monkeypatch.setattr(episode_player, "episode_for", lambda *_: None)
    both: tuple[dict[str, Setting], ...] = ({}, {"pick_rule": "ovmm"})
    for settings in both:
        spec = episode_spec.EpisodeSpec("ovmm", "helios", "noisy", "demo-v1", 0, None, settings)
        episode_player.make_world(spec, cast(Any, None))
    assert given == ["physical", "ovmm"]


def test_an_unknown_or_useless_pick_rule_is_a_usage_error() -> None:
    with pytest.raises(UsageError, match="'magic'; wanted physical or ovmm"):
        with_pick_rule("magic")
    with pytest.raises(UsageError, match="objectnav moves no object"):
        with_pick_rule("ovmm", "objectnav")


def test_the_noise_flag_takes_each_shipped_table() -> None:
    for name in ("demo-v1", "ovmm-v1", "ovmm-v1-smooth"):
        under = parse_condition(
            ["helios"], "ovmm", semantics="noisy", preset="ovmm-v1", table=name, level=0.5,
            correlation=None, sensor="none", assignments=[], max_steps=None, scorer=None,
        )  # fmt: skip
        assert under.noise is not None
        assert (under.noise.table, under.noise.level) == (name, 0.5)
        assert under.noise.digest == load_noise(name).digest


@pytest.mark.parametrize(
    ("preset", "benchmark", "steps"),
    [
        ("ovmm-v1", "ovmm", 1250),
        ("ovmm-large-v1", "ovmm", 2500),
        ("ovmm-large-v1+sweethome3d", "ovmm", 2500),
        ("ovmm-large-v1", "objectnav", 500),
    ],
)
def test_the_preset_sets_the_number_of_steps(preset: str, benchmark: Benchmark, steps: int) -> None:
    spec = episode_spec.EpisodeSpec(benchmark, "helios", "noisy", preset, 0, None)
    assert spec.max_steps == steps


@pytest.mark.parametrize(("flag", "recorded"), [(2500, None), (1250, 1250)])
def test_a_number_of_steps_is_recorded_if_it_is_not_the_presets(
    flag: int, recorded: int | None
) -> None:
    under = parse_condition(
        ["helios"], "ovmm", semantics="ground-truth", preset="ovmm-large-v1", table=None,
        level=1.0, correlation=None, sensor="none", assignments=[], max_steps=flag, scorer=None,
    )  # fmt: skip
    assert under.settings.get("max_steps") == recorded


def test_large_homes_have_the_noise_of_ovmm_v1() -> None:
    assert home_presets.noise_of("ovmm-large-v1") == "ovmm-v1"


def test_an_agent_of_another_package_is_loaded_before_the_run() -> None:
    episode_spec.check_agents(["helios-paper", "helios_examples.left_first:agent"], "ovmm")
    for agent, said in (
        ("helios_examples.left_first:agnet", "did you mean agent"),
        ("surely_not_there:agent", "no package or module"),
        ("hal", "or package:agent of your own"),
    ):
        with pytest.raises(UsageError, match=said):
            episode_spec.check_agents([agent], "objectnav")
