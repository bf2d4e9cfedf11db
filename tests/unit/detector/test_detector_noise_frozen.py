"""File and random draws of each published noise table are frozen, so that results stay comparable.

A failure means that a published noise table has changed: give the new table a new name.
"""

import hashlib
import json

import numpy as np
import pytest
from detector_scene import context_of, looking
from helios_detector.simulation.frame_noise import load_noise
from helios_detector.simulation.view_noise_detector import ViewNoiseDetector
from helios_detector.simulation.view_noise_table import ViewNoiseTable
from test_detector_view_simulated import NamedTruth

DIGESTS = {
    "ovmm-v1": "f9dc2c4a9c5c2cf0",
    "ovmm-v1-smooth": "444107dadeea260a",
    "ovmm-v2": "7865013ce5e097f0",
}
SAID = {
    "ovmm-v1": {0.5: "4e493ba1093f6309", 1.0: "c54c019097d3c2fc", 2.0: "4408b067854155ba"},
    "ovmm-v1-smooth": {0.5: "a1b9a29b7b651855", 1.0: "f3e117073ed78fc4", 2.0: "05594fd96bf2a964"},
    "ovmm-v2": {0.5: "2a9a9ea9ee33a7d5", 1.0: "b08ae311d0554673", 2.0: "a85cd9584e68858b"},
}


def test_published_noise_tables_do_not_change():
    assert {name: load_noise(name).digest for name in DIGESTS} == DIGESTS


@pytest.mark.parametrize("name", SAID)
def test_the_simulated_detector_gives_the_frozen_detections(name):
    """60 frames of a walk past a table, at three levels: names, scores, boxes and masks."""
    assert {level: said(name, level) for level in SAID[name]} == SAID[name]


def said(name: str, level: float) -> str:
    """A hash of all detections on the walk."""
    table = load_noise(name)
    assert isinstance(table, ViewNoiseTable)
    truth = NamedTruth()
    detector = ViewNoiseDetector(truth, table.scaled(level), seed=5)
    context = context_of("mug", "bowl", "teapot", "book", "table", threshold=0.05)
    reported: list[list[object]] = []
    for n, x in enumerate(np.linspace(-2, 1, 60), 1):
        found = detector.detect(truth.frame(looking(float(x)), n), context)
        reported.append([(s.class_name, round(s.score, 6)) for s in found.seen])
        for d in found.detections:
            box = [round(float(v), 3) for v in d.box_xyxy]
            mask = hashlib.sha256(np.packbits(d.mask).tobytes()).hexdigest()
            reported.append([d.class_name, round(d.score, 6), box, mask])
    return hashlib.sha256(json.dumps(reported).encode()).hexdigest()[:16]
