"""The command that checks models on one image."""

from pathlib import Path

import cv2
import pytest
import tiny_models
from detector_scene import frame_of
from helios_detector.hf.model_check import main


@pytest.fixture
def image(tmp_path: Path) -> Path:
    path = tmp_path / "room.png"
    cv2.imwrite(str(path), frame_of().color)
    return path


def test_the_command_runs_detector_masks_scorer_and_depth_and_draws_detections(
    image: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    names = ("owlv2", "sam2", "clip", "depth-pro")
    owl, sam, clip, depth = (tiny_models.write(n, tmp_path / n) for n in names)
    status = main(
        ["--image", str(image), "--classes", "mug=0.01, table=0.01", "--repeat", "2",
         "--detector", f"transformers:{owl}", "--masks", f"transformers:{sam}",
         "--scorer", f"transformers:{clip}", "--prompt", "a mug", "--prompt", "a bed",
         "--depth", f"transformers:{depth}", "--device", "cpu"]
    )  # fmt: skip
    out = capsys.readouterr().out
    assert status == 0, out
    for words in (
        "depth transformers:",
        "detector transformers:",
        "scorer transformers:",
        "ms a frame (median of 2)",
        "mug 0.",
        "a bed",
        "focal length",
    ):
        assert words in out
    picture = cv2.imread(str(tmp_path / "room-checked.png"))
    assert picture is not None
    assert (picture != frame_of().color[..., ::-1]).any()


@pytest.mark.parametrize(
    ("args", "status", "sentence"),
    [
        ([], 2, "nothing to check"),
        (["--detector", "transformers:/no/such/folder"], 1, "is not there; put config.json"),
        (["--detector", "oracle"], 2, "there is no detector 'oracle'"),
        (["--scorer", "minilm", "--repeat", "0"], 2, "--repeat is 0"),
        (["--scorer", "minilm", "--image", "/no/image.png"], 2, "is no image that can be read"),
    ],
)
def test_a_fault_gives_one_sentence_and_an_exit_status(
    args: list[str], status: int, sentence: str, image: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["--image", str(image), *args]) == status
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize("classes", ["", " , ", "mug=often"])
def test_unreadable_classes_are_refused(
    classes: str, image: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    owl = tiny_models.write("owlv2", tmp_path / "owl")
    args = ["--image", str(image), "--detector", f"transformers:{owl}", "--classes", classes]
    assert main(args) == 2
    assert "--classes" in capsys.readouterr().err
