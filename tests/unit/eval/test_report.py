"""Tests the report of a folder: its contents, and that no text of an episode can break it."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest
from helios_core.errors import InvalidInput
from helios_eval.episodes.episode_record import EPISODES
from helios_eval.report import failure_causes, write_report
from synthetic_episodes import CHANCES, NOISE, episode, write

SECTIONS = ("What was run", "At a glance", "Every metric of this run", "Differences between agents",
            "Beside the paper", "Why episodes failed", "Time of a step", "Failed episodes",
            "All episodes", "What the words mean")  # fmt: skip
VOID = {"meta", "img", "input", "br", "link", "path", "use", "rect", "line", "circle"}
HOSTILE = (
    '<script>alert("1")</script> | $x^$ `rm` **b** [a](javascript:1) \n# ünï \\ "quoted" &amp;'
)


class Page(HTMLParser):
    """Tags, texts and addresses of a page; fails on unclosed tags."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.texts: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [v or "" for k, v in attrs if k in ("src", "href", "xlink:href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [v or "" for k, v in attrs if k in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("run")


@pytest.fixture(scope="module")
def both_reports(folder):
    """The HTML and Markdown report of a folder with several agents, both semantics, failure
    snapshots and run.json."""
    episodes = [episode(s, a) for a in CHANCES for s in range(5)]
    episodes += [episode(s, "helios-paper", semantics="ground-truth", noise=None) for s in range(5)]
    write(folder, episodes)
    run = {
        "command": ["helios", "eval", "ovmm", "--out", "a b"],
        "machine": "a desk",
        "started": "2026-01-02T03:04:05+00:00",
        "wall_s": 3725.0,
    }
    (folder / "run.json").write_text(json.dumps(run))
    write_report(folder)
    return (folder / "report.html").read_text(), (folder / "report.md").read_text()


@pytest.fixture(params=["html", "md"])
def report(request, both_reports):
    return both_reports[request.param == "md"]


def test_both_reports_contain_every_section_and_every_agent(report):
    assert [s for s in SECTIONS if s not in report] == []
    for agent in CHANCES:
        assert agent in report


def test_the_report_describes_the_run(report):
    shown = report.replace("&#39;", "'").replace("<span>", "").replace("</span>", "")
    for words in (
        "helios eval ovmm --out 'a b'",
        "a desk",
        "1 h 02 min",
        "0000000-dirty",
        "not committed",
        "0–4",
        "noise level",
    ):
        assert words in shown


def test_the_report_states_that_the_paper_used_another_simulator(report):
    assert "no figure here may be held against one of the paper in absolute terms" in report
    assert report.count("another simulator") >= 3


def test_the_report_shows_the_papers_figures_beside_ours(report):
    assert "42.3 ± 1.4" in report
    assert "Table 1" in report
    assert "Table 4" in report
    assert re.search(r"Not run: Table 2, 5, 6, 7 and 8", report)


def test_the_page_is_valid_and_loads_nothing_from_outside(both_reports):
    page = Page(both_reports[0])
    assert page.tags.count("script") == 1
    assert "svg" in page.tags
    outside = [a for a in page.addresses if not a.startswith(("#", "data:"))]
    assert outside == []
    assert "@import" not in both_reports[0]
    assert re.findall(r"url\((?!#|&quot;#|data:)", both_reports[0]) == []


def test_the_markdown_shows_every_drawing_of_the_page_from_a_standalone_svg_file(
    both_reports, folder
):
    shown = re.findall(r"!\[[^]]+\]\((drawings/[a-z0-9-]+\.svg)\)", both_reports[1])
    assert len(shown) == len(re.findall(r"<svg", both_reports[0]))
    assert {folder / name for name in shown} == set((folder / "drawings").iterdir())
    for name in shown:
        svg = (folder / name).read_text()
        root = ElementTree.fromstring(svg)
        assert float(root.attrib["width"]) > 100
        assert float(root.attrib["height"]) > 50
        asked = set(re.findall(r"var\((--[a-z0-9-]+)\)", svg))
        light, dark = svg.split("@media (prefers-color-scheme:dark)")
        assert asked <= set(re.findall(r"(--[a-z0-9-]+):", light))
        assert asked - {"--sans"} <= set(re.findall(r"(--[a-z0-9-]+):", dark))


def test_a_later_report_deletes_drawings_that_it_does_not_have(tmp_path):
    write(tmp_path, [episode(s, a) for s in range(8) for a in ("helios-paper", "trusting")])
    write_report(tmp_path)
    assert (tmp_path / "drawings" / "answers.svg").exists()
    write(tmp_path, [episode(s, "helios-paper") for s in range(2)])
    write_report(tmp_path)
    assert not (tmp_path / "drawings" / "answers.svg").exists()


def test_drawings_follow_the_light_and_dark_theme(both_reports):
    drawn = re.findall(r"<svg.*?</svg>", both_reports[0], flags=re.DOTALL)
    assert len(drawn) >= 5
    assert all("var(--ink)" in svg and "#1c2430" not in svg for svg in drawn)
    assert "prefers-color-scheme: dark" in both_reports[0]
    assert "@media print" in both_reports[0]


def test_failure_images_show_the_commands_to_replay_and_film_the_episode(both_reports):
    failed = sum(bool(episode(s, "trusting").cause) for s in range(5))
    assert failed > 0
    assert both_reports[0].count('alt="Map of the episode') >= failed
    page = both_reports[0].replace("<span>", "").replace("</span>", "")
    how = "--preset synthetic --semantics noisy --scorer lexical"
    again = rf"--agents trusting --episodes 1 --seed0 \d {how} --out"
    film = rf"helios eval video --seed \d --agent trusting {how}<"
    assert re.search(again, page)
    assert re.search(film, page)
    assert "--agent ground-truth-walker" not in page  # the walker has no maps
    png = re.search(r"image/png;base64,([^\"]+)", both_reports[0])
    assert png is not None
    assert base64.b64decode(png[1]).startswith(b"\x89PNG")


def test_the_report_names_the_image_text_scorers(tmp_path):
    of = {"detector.scorer": "simulated:itc-v1"}
    write(tmp_path, [episode(0), episode(1, "trusting", settings=of)])
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    assert re.search(r"image-text scorer.*lexical, simulated:itc-v1", markdown)


def test_the_report_names_the_pick_rule_and_replays_it(tmp_path):
    failed = {"success": False, "cause": "object not found"}
    write(tmp_path, [episode(s, settings={"pick_rule": "ovmm"}, **failed) for s in range(2)])
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    assert "ovmm: a pick fails where nothing of the sought class is in reach" in markdown
    assert "pick_rule=ovmm" not in markdown
    assert failure_causes.replay(episode(0, settings={"pick_rule": "ovmm"})) == (
        "helios eval ovmm --agents helios-paper --episodes 1 --seed0 0 --preset synthetic "
        "--semantics noisy --scorer lexical --pick-rule ovmm --out runs/again"
    )
    assert "--pick-rule ovmm" in failure_causes.film(episode(0, settings={"pick_rule": "ovmm"}))
    write(tmp_path, [episode(s, **failed) for s in range(2)])
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    assert "physical: a pick takes what lies at the point" in markdown
    assert "--pick-rule" not in markdown + failure_causes.replay(episode(0))


def test_an_episode_with_a_real_detector_is_replayed_with_its_scorer_and_level(tmp_path):
    def of(scorer, **fields):
        settings = {"detector.scorer": scorer, "detector.detector": "onnx:m.onnx@0123"}
        return episode(0, semantics="detector", noise=None, settings=settings, **fields)

    assert "--scorer simulated:itc-v1" in failure_causes.replay(of("simulated:itc-v1"))
    assert "--scorer" not in failure_causes.replay(of("lexical"))
    at = "flat.sh3d sha256:01 level:First floor things:02"
    upstairs = of("lexical", home_file=at, preset="flat.sh3d@0123456789ab")
    assert "--homes flat.sh3d --level 'First floor'" in failure_causes.replay(upstairs)


def test_a_report_of_real_and_simulated_detections_says_so_of_both(tmp_path):
    write(tmp_path, [episode(0), episode(1, semantics="detector", noise=None)])
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    assert "a detector whose errors are drawn from a table" in markdown
    assert "with the detections of a real model" in markdown


def test_markup_in_episode_texts_is_escaped(tmp_path):
    wicked = {"instruction": HOSTILE, "message": HOSTILE, "cause": HOSTILE, "preset": HOSTILE,
              "commit": HOSTILE, "settings": {HOSTILE: HOSTILE}, "stage_ms": {HOSTILE: 1.0},
              "success": False, "noise": NOISE.model_copy(update={"table": HOSTILE}),
              "collided_with": (HOSTILE,)}  # fmt: skip
    write(tmp_path, [episode(s, a, **wicked) for s in (0, 1) for a in ("helios-paper", "trusting")])
    (tmp_path / "run.json").write_text(json.dumps({"command": HOSTILE, "machine": HOSTILE}))
    write_report(tmp_path)
    page = Page((tmp_path / "report.html").read_text())
    assert page.tags.count("script") == 1  # the report's own
    assert HOSTILE in "".join(page.texts)
    markdown = (tmp_path / "report.md").read_text()
    outside_code = re.sub(r"(`+) .*? \1(?!`)", "", markdown)
    assert "<script>" not in outside_code
    assert not re.search(r"^# ünï", markdown, flags=re.MULTILINE)
    for table in re.findall(r"(?:^\|.*\n)+", markdown, flags=re.MULTILINE):
        bars = {len(re.findall(r"(?<!\\)\|", line)) for line in table.splitlines()}
        assert len(bars) == 1, table


def test_a_report_of_one_agent_without_failures_images_or_run_json_is_written(tmp_path):
    won = {"find_object": True, "pick": True, "find_receptacle": True, "place": True,
           "success": True, "cause": "", "collisions": 0, "stage_ms": {},
           "beliefs": ()}  # fmt: skip
    write(tmp_path, [episode(s, "helios-paper", **won) for s in range(3)])
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    assert "There is one agent only" in markdown
    assert "none failed" in markdown
    assert "do not say how long each stage took" in markdown
    assert "hold no beliefs of the object map" in markdown


def test_a_single_episode_gives_a_report_without_standard_errors(tmp_path):
    write(tmp_path, [episode(3, "helios-paper")])
    write_report(tmp_path)
    assert "nan" not in (tmp_path / "report.md").read_text().lower()


@pytest.mark.parametrize("homes", [1, 3])
def test_few_homes_give_figures_but_no_verdict(tmp_path, homes):
    won = {"find_object": True, "pick": True, "success": True, "cause": ""}
    lost = {"find_object": False, "pick": False, "success": False, "cause": "stuck"}
    arms = (("helios-paper", won), ("trusting", lost))
    write(tmp_path, [episode(s, a, **met) for s in range(homes) for a, met in arms], pictures=False)
    write_report(tmp_path)
    for name in ("report.md", "report.html"):
        report = (tmp_path / name).read_text()
        assert "too few homes to tell" in report
        assert not re.search(r"(larger|smaller) here", report)
        assert 'class="n good"' not in report
        assert 'class="n bad"' not in report


def test_the_report_of_an_incomplete_run_states_the_missing_episodes(tmp_path):
    there = [episode(s, a) for s in (0, 1) for a in ("helios-paper", "trusting")]
    write(tmp_path, there[:3], pictures=False)
    run = {
        "benchmark": "ovmm",
        "agents": ["helios-paper", "trusting"],
        "semantics": "noisy",
        "preset": "synthetic",
        "noise": NOISE.model_dump(),
        "settings": {},
        "seed0": 0,
        "episodes": 2,
    }
    (tmp_path / "run.json").write_text(json.dumps(run))
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    assert "Not complete: 1 of the 4 episodes" in markdown
    assert re.search(r"trusting .*\*\*1\*\* \(of 2\)", markdown)
    assert "the same homes (helios-paper 2, trusting 1; 1 home in common)" in markdown
    write(tmp_path, there, pictures=False)
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    assert "Not complete" not in markdown
    assert "not every row is over the same homes" not in markdown


def test_the_report_states_episodes_per_hour_and_core(tmp_path):
    """Records that lack their CPU time, of former runs, are left out."""
    write(tmp_path, [episode(0, cpu_s=30.0), episode(1, cpu_s=50.0), episode(2)], pictures=False)
    write_report(tmp_path)
    assert re.search(r"episodes per hour and core.*\b90\.0\b", (tmp_path / "report.md").read_text())
    write(tmp_path, [episode(0)], pictures=False)
    write_report(tmp_path)
    assert "episodes per hour" not in (tmp_path / "report.md").read_text()


def test_equally_frequent_causes_are_not_ranked(tmp_path):
    causes = ("stuck", "pick failed")
    write(
        tmp_path, [episode(s, cause=c, success=False) for s, c in enumerate(causes)], pictures=False
    )
    write_report(tmp_path)
    assert "most frequent cause" not in (tmp_path / "report.md").read_text()


def test_an_episode_that_never_began_is_reported(tmp_path):
    lost = {"cause": "system error", "steps": 0, "step_ms": 0.0, "wall_s": 0.0, "path_m": 0.0,
            "instruction": "", "structure_hash": "", "stage_ms": {}, "success": False,
            "collisions": 0, "beliefs": ()}  # fmt: skip
    write(tmp_path, [episode(0, "helios-paper", **lost)], pictures=False)
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    assert "1 episode ended by a system error" in markdown
    assert "leave out those that could not be played: 1." in markdown
    assert "No episode took a step" in markdown


def test_means_of_steps_name_the_episodes_that_were_played(tmp_path):
    lost = {"cause": "system error", "steps": 0, "structure_hash": "", "success": False,
            "collisions": 0}  # fmt: skip
    never = [episode(s, a, **lost) for s, a in ((2, "helios-paper"), (0, "a"), (1, "a"))]
    there = [episode(s, steps=100, success=False, cause="stuck") for s in range(2)]
    write(tmp_path, [*there, *never], pictures=False)
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    took = markdown.partition("what it took")[2]
    assert re.search(r"helios-paper \|.* 100\.0 ± 0\.0 .*2.*\(of 3\)", took)
    assert re.search(r"\| a \|.* – .*0.*\(of 2\)", took)
    collisions = markdown.partition("Steps and collisions")[2]
    assert re.search(r"helios-paper \| .*2.* \(of 3\) \| 100\.0 ± 0\.0", collisions)


def test_object_navigation_has_its_own_metrics(tmp_path):
    agents = ("vlfm", "vlfm-unfiltered", "vlfm-helios-stop")
    write(
        tmp_path,
        [
            episode(s, a, benchmark="objectnav", shortest_path_m=2.0)
            for s in range(5)
            for a in agents
        ],
    )
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    assert "Table 2" in markdown
    assert "SPL: VLFM with the stop decision of HELIOS over VLFM" in markdown
    assert "FindRec" not in markdown.partition("All episodes")[0]


def test_rows_without_a_colour_still_appear_in_the_tables(tmp_path):
    sweep = [{"planner.tau_g": round(0.1 * i, 1)} for i in range(10)]
    write(
        tmp_path,
        [episode(s, settings=e, beliefs=()) for s in range(2) for e in sweep],
        pictures=False,
    )
    write_report(tmp_path)
    markdown = (tmp_path / "report.md").read_text()
    assert "8 of 10 rows" in markdown
    for settings in sweep:
        assert f"planner.tau\\_g={settings['planner.tau_g']}" in markdown


def test_the_same_folder_gives_the_same_report(tmp_path):
    write(tmp_path, [episode(s, "trusting") for s in range(3)])
    write_report(tmp_path)
    first = (tmp_path / "report.html").read_bytes()
    write_report(tmp_path)
    assert (tmp_path / "report.html").read_bytes() == first


def test_a_folder_without_episodes_is_refused_with_advice(tmp_path):
    with pytest.raises(InvalidInput, match="helios eval ovmm"):
        write_report(tmp_path)
    (tmp_path / EPISODES).write_text("")
    with pytest.raises(InvalidInput, match="no episode"):
        write_report(tmp_path)


@pytest.mark.parametrize("torn", ["{", "[1, 2]"])
def test_an_invalid_run_json_is_refused_by_name(tmp_path, torn):
    write(tmp_path, [episode(0)])
    (tmp_path / "run.json").write_text(torn)
    with pytest.raises(InvalidInput, match=r"run\.json"):
        write_report(tmp_path)
