"""`helios eval video` from the command to the file."""

import cv2
import pytest
from helios_client.wrong_use import WrongUse
from helios_eval.video.command import video


def test_a_short_episode_is_filmed(tmp_path, capsys):
    path = tmp_path / "film.mp4"
    video(seed=4, out=path, preset="demo-v1", semantics="ground-truth", fps=8.0, max_steps=2)
    assert "written to" in capsys.readouterr().out
    reader = cv2.VideoCapture(str(path))
    frames = []
    while (got := reader.read())[0]:
        frames.append(got[1])
    reader.release()
    assert frames[0].shape == (720, 1280, 3)
    assert len(frames) >= 8 + 1 + 24  # the first step for a second, the second, the end for three
    assert frames[0][110:, :360].std() > 20  # the camera
    assert frames[0][110:, 380:840].std() > 20  # the maps


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"agent": "nobody"}, "nobody"),
        ({"preset": "castle"}, "castle"),
        ({"semantics": "guessed"}, "guessed"),
        ({"benchmark": "chess"}, "chess"),
        ({"agent": "ground-truth-walker"}, "no maps"),
    ],
)
def test_wrong_use_is_told(tmp_path, wrong, told):
    with pytest.raises(WrongUse, match=told):
        video(**{"seed": 1, "out": tmp_path / "a.mp4", "preset": "demo-v1", **wrong})
    with pytest.raises(WrongUse, match=r"FILE\.mp4"):
        video(seed=1, out=tmp_path / "film.avi", preset="demo-v1")
    assert not list(tmp_path.iterdir())
