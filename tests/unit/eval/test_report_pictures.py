"""Tests the images of failed episodes in a report."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helios_eval.episodes import failure_snapshot
from helios_eval.report import write_report
from helios_eval.report.agent_groups import arms_of
from helios_eval.report.failure_causes import gallery_section
from helios_eval.report.report_model import Gallery
from synthetic_episodes import NOISE, episode, kept, write

LOST = {"success": False, "place": False, "cause": "stuck"}


def test_a_report_shows_at_most_twelve_images_per_agent(tmp_path):
    write(tmp_path, [episode(s, "helios-paper", **LOST) for s in range(15)])
    write_report(tmp_path)
    assert (tmp_path / "report.html").read_text().count('alt="Map of the episode') == 12
    assert "12 of 15 failures" in (tmp_path / "report.md").read_text()


def test_an_image_is_shown_with_the_row_of_its_episode(tmp_path):
    louder = NOISE.model_copy(update={"level": 2.0})
    plain, loud = episode(0, **LOST), episode(0, noise=louder, **LOST)
    for one, jpeg in ((plain, b"plain"), (loud, b"loud")):
        failure_snapshot.save(tmp_path, replace(kept(one), camera_jpeg=jpeg))
    blocks = gallery_section(tmp_path, arms_of([plain, loud])).blocks
    found = {b.title: [p.jpeg for p in b.pictures] for b in blocks if isinstance(b, Gallery)}
    assert found == {"helios-paper": [b"plain"], "helios-paper · noise ×2": [b"loud"]}


@pytest.mark.parametrize("left", [0, 40, -40])
def test_a_damaged_snapshot_is_left_out_and_named(tmp_path, left):
    write(tmp_path, [episode(s, **LOST) for s in range(3)])
    damaged = failure_snapshot.all_of(tmp_path)[1]
    damaged.write_bytes(damaged.read_bytes()[:left])
    write_report(tmp_path)
    assert (tmp_path / "report.html").read_text().count('alt="Map of the episode') == 2
    assert (
        f"Without 1 picture: {damaged.name} cannot be read" in (tmp_path / "report.md").read_text()
    )
