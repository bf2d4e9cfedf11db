"""YOLOX: letter-box, decoding, suppression, and faulty model files."""

import numpy as np
import pytest
from helios_core.errors import InvalidInput, Unavailable
from helios_detector.yolox_detector import YoloxDetector, decode, letter_box, suppressed

SIZE = (64, 96)
CELLS = [
    (stride, x, y)
    for stride in (8, 16, 32)
    for y in range(64 // stride)
    for x in range(96 // stride)
]


def test_letter_box_keeps_proportions_and_pads_with_grey_at_the_end():
    color = np.zeros((50, 100, 3), np.uint8)
    color[..., 0] = 200  # red
    image, scale = letter_box(color, SIZE)
    assert image.shape == (1, 3, 64, 96)
    assert scale == pytest.approx(0.96)
    np.testing.assert_array_equal(image[0, :, 10, 10], [0, 0, 200])  # BGR
    np.testing.assert_array_equal(image[0, :, 60, 10], [114, 114, 114])


def test_decode_agrees_with_a_loop_over_cells():
    rng = np.random.default_rng(0)
    output = rng.normal(0, 1, (len(CELLS), 8)).astype(np.float32)
    boxes, scores = decode(output, SIZE)
    for i, (stride, x, y) in enumerate(CELLS):
        cx, cy = (output[i, 0] + x) * stride, (output[i, 1] + y) * stride
        w, h = np.exp(output[i, 2]) * stride, np.exp(output[i, 3]) * stride
        wanted = [cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2]
        np.testing.assert_allclose(boxes[i], wanted, rtol=1e-4, atol=1e-3)
        np.testing.assert_allclose(scores[i], output[i, 4] * output[i, 5:], rtol=1e-5)


def test_decode_refuses_an_output_of_another_grid():
    with pytest.raises(InvalidInput, match="cells"):
        decode(np.zeros((5, 85), np.float32), SIZE)


def test_suppression_keeps_the_best_of_overlapping_boxes():
    boxes = np.array([[0, 0, 10, 10], [1, 0, 11, 10], [30, 0, 40, 10]], np.float32)
    assert suppressed(boxes, np.array([0.5, 0.9, 0.6], np.float32)) == [1, 2]
    assert suppressed(boxes[:0], np.zeros(0, np.float32)) == []


def test_missing_model_file_is_unavailable_and_says_what_to_do(tmp_path):
    with pytest.raises(Unavailable, match=r"nothing\.onnx is not there; put a YOLOX model"):
        YoloxDetector(tmp_path / "nothing.onnx")


def test_a_file_that_is_no_model_is_invalid(tmp_path):
    pytest.importorskip("onnxruntime")
    path = tmp_path / "broken.onnx"
    path.write_bytes(b"not a model")
    with pytest.raises(InvalidInput, match="cannot be loaded"):
        YoloxDetector(path)


def test_suppression_keeps_at_most_the_best_50_boxes():
    corner = 20 * np.arange(60, dtype=np.float32)
    boxes = np.stack([corner, corner, corner + 9, corner + 9], 1)
    scores = np.linspace(0.3, 0.9, 60, dtype=np.float32)
    assert suppressed(boxes, scores) == list(range(59, 9, -1))
