"""`helios calibrate`: things of recordings, known places, and the files that it writes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import cv2
import numpy as np
import pytest
from helios_client.cli import run
from helios_core.detector_error_model import read_error_model
from helios_core.errors import InvalidInput
from helios_core.household_names import OBJECTS
from helios_core.types import Detection, Frame, SearchContext
from helios_detector.backend import DetectorBackend, DetectorOptions, Findings
from helios_eval.error_models import simulated_homes
from helios_eval.error_models.model_building import score_points
from helios_eval.error_models.named_things import KnownPlace, NamedThing, with_places
from helios_eval.error_models.recordings import look_at_recordings, read_places
from helios_eval.studies.detector_errors.sightings import FalseAlarms, Sightings
from helios_objectmap.error_model import name_errors
from helios_objectmap.settings import ObjectMapSettings

NAMES = sorted(OBJECTS)[:24]
THINGS, VIEWS = 12, 8
SHAPE, FOCAL_PX = (120, 160), 120.0
HERE = f"{__name__}:Stickers"


def center_m(thing: int) -> tuple[float, float, float]:
    return -0.45 + 0.3 * (thing % 4), -0.3 + 0.3 * (thing // 4), 1.2


def boxes_px(camera_x_m: float) -> list[tuple[int, int, int, int]]:
    """Boxes of all things (12 cm wide) for a camera at x that looks along z."""
    out = []
    for thing in range(THINGS):
        x, y, z = center_m(thing)
        u, v = FOCAL_PX * (x - camera_x_m) / z + 79.5, FOCAL_PX * y / z + 59.5
        half = FOCAL_PX * 0.06 / z
        out.append((round(u - half), round(v - half), round(u + half), round(v + half)))
    return out


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Views of twelve stickers; the camera moves 0.1 m to the side between them."""
    out = tmp_path_factory.mktemp("stickers")
    (out / "frames").mkdir()
    meta = {"width": 160, "height": 120, "fx": FOCAL_PX, "fy": FOCAL_PX, "cx": 79.5, "cy": 59.5}
    (out / "meta.json").write_text(json.dumps(meta | {"depth_scale_m": 0.001}))
    lines = ["frame,t_s,r00,r01,r02,tx,r10,r11,r12,ty,r20,r21,r22,tz"]
    for k in range(VIEWS):
        x_m = 0.1 * (k - VIEWS / 2)
        depth_mm = np.full(SHAPE, 2500, np.uint16)
        for x0, y0, x1, y1 in boxes_px(x_m):
            depth_mm[y0:y1, max(x0, 0) : max(x1, 0)] = 1200
        cv2.imwrite(str(out / "frames" / f"{k:06d}.png"), depth_mm)
        cv2.imwrite(str(out / "frames" / f"{k:06d}.jpg"), np.full((*SHAPE, 3), 128, np.uint8))
        lines.append(f"{k},{k},1,0,0,{x_m},0,1,0,0,0,0,1,0")
    (out / "poses.csv").write_text("\n".join(lines) + "\n")
    return out


class Stickers(DetectorBackend):
    """Gives thing k name k in three views of four, and name 12 + k in one of four."""

    name = "stickers"

    def __init__(self, options: DetectorOptions | None = None) -> None:
        del options

    def vocabulary(self):
        return None

    def refused(self, context):
        return {}

    def warm_up(self):
        return

    def close(self):
        return

    def detect(self, frame: Frame, context: SearchContext) -> Findings:
        out = []
        x_m = float(frame.T_world_cam[0, 3])
        view = round(x_m / 0.1 + VIEWS / 2)
        for thing, box in enumerate(boxes_px(x_m)):
            mask = np.zeros(SHAPE, bool)
            mask[box[1] : box[3], max(box[0], 0) : max(box[2], 0)] = True
            wrong = (view + thing) % 4 == 0
            name = NAMES[thing + THINGS * wrong]
            if mask.any():
                out.append(Detection(name, 0.9, box, mask))
        return Findings(tuple(out), ())


@pytest.fixture(scope="module")
def things(folder: Path) -> Sequence[NamedThing]:
    quiet = ObjectMapSettings(side_views=2.0)
    return look_at_recordings([folder], HERE, (), 1, quiet, lambda _: None).things


def test_a_detector_is_closed_also_after_an_error(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed: list[Stickers] = []
    monkeypatch.setattr(Stickers, "close", lambda model: closed.append(model))

    def broken(*_: object) -> NoReturn:
        raise InvalidInput("no more")

    quiet = ObjectMapSettings(side_views=2.0)
    with pytest.raises(InvalidInput, match="no more"):
        look_at_recordings([folder], HERE, (), 1, quiet, broken)
    assert len(closed) == 1
    monkeypatch.setattr(simulated_homes, "generate_home", broken)
    with pytest.raises(InvalidInput, match="no more"):
        simulated_homes.look_at_homes(HERE, [0], "demo-v1", 1, 1, quiet, print)
    assert len(closed) == 3  # with that which named its vocabulary


def test_detections_that_share_voxels_are_one_thing(things: Sequence[NamedThing]) -> None:
    assert len(things) == THINGS
    for thing in things:
        first, second = sorted(NAMES.index(name) for name in thing.rates.names)
        assert second == first + THINGS
        assert np.linalg.norm(thing.center_m - center_m(first)) < 0.1


def test_the_nearest_thing_gets_the_right_name_of_a_place(things: Sequence[NamedThing]) -> None:
    told = with_places(
        things, [KnownPlace(("cup", "mug"), center_m(5)), KnownPlace(("cup",), (9, 9, 9))]
    )
    right = [t for t in told if t.right is not None]
    assert [t.right for t in right] == [("cup", "mug")]
    assert NAMES[5] in right[0].rates.names


def test_a_recording_gives_a_file_that_the_map_takes(folder: Path, tmp_path: Path, capsys) -> None:
    places = tmp_path / "places.csv"
    rows = [f"{NAMES[k]},{','.join(map(str, center_m(k)))}" for k in range(3)]
    places.write_text("\n".join(["name,x,y,z", *rows]))
    out, chart = tmp_path / "model.json", tmp_path / "chart.png"
    given = ["calibrate", str(folder), "--detector", HERE, "--out", str(out)]
    assert run([*given, "--places", str(places), "--chart", str(chart)]) == 0
    told = capsys.readouterr()
    model = read_error_model(out)
    assert (model.detector, model.source.truth) == ("stickers", "some truth")
    assert (model.source.things, model.source.things_with_truth) == (THINGS, 3)
    assert 0.6 < model.names.hit.value < 0.9
    assert model.names.mistaken.value < 0.4
    assert name_errors(str(out)).hit == model.names.hit.value
    assert chart.read_bytes().startswith(b"\x89PNG")
    assert "truth of 3 of them" in told.out
    assert "looks like the truth" in told.out


def test_homes_give_a_model_with_rates_and_scores(tmp_path: Path) -> None:
    out = tmp_path / "model.json"
    given = ["calibrate", "--homes", "20", "--things", "4", "--detector", "simulated:ovmm-v1"]
    assert run([*given, "--out", str(out), "--json"]) == 0
    model = read_error_model(out)
    assert model.source.truth == "truth"
    assert model.detector.startswith("simulated:ovmm-v1@")
    assert model.rates_by_pixels
    assert model.false_alarms_per_image is not None
    points = [p.right for p in model.score_calibration]
    assert points == sorted(points)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--detector", "recorded"], "name recordings, or simulated homes"),
        (["x.mcap", "--homes", "0", "--detector", "recorded"], "not both"),
        (["--homes", "5-3", "--detector", "simulated:ovmm-v1"], "--homes is '5-3'"),
        (["--homes", "990-1000", "--detector", "simulated:ovmm-v1"], "homes below 1000"),
        (["--homes", "0", "--preset", "no", "--detector", "simulated:ovmm-v1"], "no preset"),
        (["--homes", "0", "--detector", "recorded"], "recorded needs recordings"),
        (["x.mcap", "--detector", "simulated:ovmm-v1"], "simulated:ovmm-v1 needs --homes"),
    ],
)
def test_wrong_use_is_told_in_one_sentence(given, said, tmp_path: Path, capsys) -> None:
    assert run(["calibrate", *given, "--out", str(tmp_path / "model.json")]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_a_wrong_setting_of_the_map_is_told_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys
) -> None:
    monkeypatch.setenv("HELIOS_OBJECTMAP_STRIDE_PX", "abc")
    given = ["calibrate", "--homes", "0", "--detector", "simulated:ovmm-v1"]
    assert run([*given, "--out", str(tmp_path / "model.json")]) == 1
    error = capsys.readouterr().err
    assert "wrong setting of objectmap: stride_px" in error
    assert error.count("\n") == 1


def test_images_alone_have_no_recorded_detections(folder: Path, tmp_path: Path, capsys) -> None:
    given = ["calibrate", str(folder), "--detector", "recorded", "--out", str(tmp_path / "m.json")]
    assert run(given) == 1
    assert "nothing that a detector found" in capsys.readouterr().err
    assert not (tmp_path / "m.json").exists()


@pytest.mark.parametrize(
    "text", ["", "name,x,y\ncup,1,2\n", "name,x,y,z\n,1,2,3\n", "name,x,y,z\ncup,1,2,inf\n"]
)
def test_places_that_cannot_be_read_are_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "places.csv"
    path.write_text(text)
    with pytest.raises(InvalidInput, match=r"places\.csv"):
        read_places(path)


def test_score_points_rise_to_the_share_that_is_right() -> None:
    rng = np.random.default_rng(0)
    score = rng.uniform(0.1, 1, 4000)
    right = rng.random(4000) < score**2
    n = int(right.sum())
    number, one, text = np.zeros(n, np.int64), np.ones(n), np.full(n, "cup")
    seen = Sightings(
        home=number, thing=number, view=number, class_name=text, pixels=one, distance_m=one,
        angle_rad=one, unobstructed=one > 0, right=score[right], wrong=0 * one, wrong_name=text,
        wrong_names=number,
    )  # fmt: skip
    alarms = FalseAlarms(
        1, 1, score[~right], np.full(4000 - n, "cup"), score[~right], score[~right]
    )
    points = score_points(seen, alarms)
    assert len(points) > 5
    for point in points:
        assert point.right == pytest.approx(point.score**2, abs=0.1)
    assert (
        score_points(
            seen.part(np.zeros(n, bool)),
            FalseAlarms(0, 1, score[:0], text[:0], score[:0], score[:0]),
        )
        == ()
    )
