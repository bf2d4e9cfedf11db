"""YOLOX detector on ONNX Runtime: letter box, decoding, non-maximum suppression, masks by depth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from helios_core.errors import InvalidInput, Unavailable
from helios_core.models.catalogue import known, missing_sentence
from helios_core.types import Detection, Frame, SearchContext
from numpy.typing import NDArray

from helios_detector.backend import SEEN_SCORE, DetectorBackend, Findings, Seen
from helios_detector.box_to_mask import box_to_mask, clip_box
from helios_detector.detection_filtering import suppressed
from helios_detector.onnx_class_names import class_names
from helios_detector.vocabulary_matching import fixed_wanted, refuse_unknown

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

    from helios_detector.name_similarity import NearestName

STRIDES_PX = (8, 16, 32)
PAD_GREY = 114
LARGEST_LOG = 12.0  # limit of the log of a box's size in cells: larger than any image


def letter_box(
    color: NDArray[np.uint8],  # [h, w, 3] RGB
    size: tuple[int, int],  # (height, width) of the network's input
) -> tuple[NDArray[np.float32], float]:
    """(input [1, 3, H, W] BGR 0-255 with the image in the upper left corner, input pixels per image
    pixel)."""
    scale = min(size[0] / color.shape[0], size[1] / color.shape[1])
    width, height = round(color.shape[1] * scale), round(color.shape[0] * scale)
    padded = np.full((*size, 3), PAD_GREY, np.uint8)
    padded[:height, :width] = cv2.resize(color, (max(1, width), max(1, height)))
    return np.ascontiguousarray(padded[..., ::-1].transpose(2, 0, 1), np.float32)[None], scale


def cells_of(size: tuple[int, int]) -> int:
    """Number of output rows for an input of size (height, width)."""
    return sum((size[0] // stride) * (size[1] // stride) for stride in STRIDES_PX)


def decode(
    output: NDArray[np.float32],  # [n, 5 + classes]: centre, size, objectness, classes
    size: tuple[int, int],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(boxes [n, 4] xyxy in input pixels, scores [n, classes]), with grid and strides applied.

    Raises InvalidInput when the number of cells does not fit the input size.
    """
    corners, strides = [], []
    for stride in STRIDES_PX:
        rows, columns = size[0] // stride, size[1] // stride
        y, x = np.mgrid[0:rows, 0:columns]
        corners.append(np.stack([x, y], -1).reshape(-1, 2))
        strides.append(np.full((rows * columns, 1), stride))
    corner, stride = np.concatenate(corners), np.concatenate(strides)
    if len(corner) != len(output):  # possible when the model declares a dynamic number of rows
        raise InvalidInput(
            f"the model gives {len(output)} cells for an input of {size}, wanted {len(corner)}; "
            f"use a YOLOX model with strides {STRIDES_PX} and undecoded output"
        )
    centre = (output[:, :2] + corner) * stride
    half = np.exp(np.minimum(output[:, 2:4], LARGEST_LOG)) * stride / 2
    boxes = np.concatenate([centre - half, centre + half], 1).astype(np.float32)
    return boxes, output[:, 4:5] * output[:, 5:]


def open_session(path: Path, threads: int) -> InferenceSession:
    """ONNX Runtime session of a model file.

    Raises Unavailable when the file or onnxruntime is missing, InvalidInput for an invalid file.
    """
    if not path.is_file() and known(str(path)):
        raise Unavailable(missing_sentence(str(path)))
    if not path.is_file():
        raise Unavailable(
            f"the model file {path} is not there; put a YOLOX model (ONNX) there, or set "
            "detector to onnx:FILE with the right file"
        )
    try:
        import onnxruntime
    except ImportError as error:
        raise Unavailable(
            "helios-detector needs onnxruntime for onnx:FILE: pip install 'helios-ovmm[detector]'"
        ) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exception types have no common base
        reason = str(error).splitlines()[0][:200]
        raise InvalidInput(
            f"{path} cannot be loaded as an ONNX model ({reason}); use a YOLOX model"
        ) from error


def sizes_of(session: InferenceSession, path: Path) -> tuple[tuple[int, int], int]:
    """((height, width) of the input, number of classes).

    Raises InvalidInput for a network that is not a YOLOX with undecoded output.
    """
    wanted, given = session.get_inputs()[0], session.get_outputs()[0]
    shape = wanted.shape
    if len(shape) != 4 or not all(isinstance(n, int) for n in shape[2:]):
        raise InvalidInput(f"{path} takes {shape}; wanted [1, 3, height, width] of fixed size")
    if wanted.type != "tensor(float)":
        raise InvalidInput(f"{path} takes {wanted.type}; export it with an input of float32")
    size = int(shape[2]), int(shape[3])
    cells = cells_of(size)
    classes = given.shape[-1] - 5 if isinstance(given.shape[-1], int) else 0
    rows = given.shape[1] if len(given.shape) == 3 else 0
    if classes < 1 or (isinstance(rows, int) and rows != cells):
        raise InvalidInput(
            f"{path} gives {given.shape}; wanted [1, {cells}, 5 + classes], as a YOLOX with "
            f"strides {STRIDES_PX} and undecoded output does"
        )
    return size, classes


class YoloxDetector(DetectorBackend):
    """A YOLOX model with a fixed vocabulary on the CPU."""

    def __init__(self, path: Path, threads: int = 1, by_similarity: bool = False) -> None:
        """Raises Unavailable when the file, onnxruntime or the text model is missing, InvalidInput
        for a file that is not a YOLOX model."""
        self._session = open_session(path, threads)
        self._size, classes = sizes_of(self._session, path)
        self._input = self._session.get_inputs()[0].name
        metadata = self._session.get_modelmeta().custom_metadata_map
        self._names = class_names(path, metadata, classes)
        self.name = f"onnx:{path.name}"
        self._similar: NearestName | None = None
        if by_similarity:
            from helios_detector.name_similarity import NearestName

            self._similar = NearestName(self._names, threads)

    def vocabulary(self) -> tuple[str, ...]:
        return self._names

    def refused(self, context: SearchContext) -> Mapping[str, str]:
        return fixed_wanted(context, self._names, self._similar)[1]

    def warm_up(self) -> None:
        self._run(np.full((*self._size, 3), PAD_GREY, np.uint8))
        if self._similar is not None:
            self._similar.warm_up()

    def unload(self) -> None:
        """Unload only the text model; the small network stays in memory."""
        if self._similar is not None:
            self._similar.unload()

    def close(self) -> None:
        """Unload the text model; the session is freed with this object."""
        self.unload()

    def detect(self, frame: Frame, context: SearchContext) -> Findings:
        wanted, refused = fixed_wanted(context, self._names, self._similar)
        refuse_unknown(refused)
        boxes, scores = self._run(frame.color)
        detections: list[Detection] = []
        for want in wanted:
            own = [i for i, name in enumerate(self._names) if name in want.names]
            own_scores = scores[:, own].max(1)
            some = np.flatnonzero((own_scores >= want.threshold) & (own_scores > 0))
            for i in some[suppressed(boxes[some], own_scores[some])]:
                x0, y0, x1, y1 = (float(v) for v in boxes[i])
                box = clip_box((x0, y0, x1, y1), *frame.depth_m.shape)
                if box is None:
                    continue
                mask = box_to_mask(
                    frame.depth_m,
                    box,
                    frame.camera,
                    frame.T_world_cam,
                    keep_surface=want.keep_surface,
                )
                detections.append(Detection(want.name, float(own_scores[i]), box, mask))
        best = scores.max(0)
        seen = tuple(
            Seen(self._names[i], float(best[i])) for i in np.flatnonzero(best >= SEEN_SCORE)
        )
        return Findings(tuple(detections), seen)

    def _run(self, color: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(boxes [n, 4] in image pixels, scores [n, classes])."""
        image, scale = letter_box(color, self._size)
        output = np.asarray(self._session.run(None, {self._input: image})[0], np.float32)[0]
        boxes, scores = decode(output, self._size)
        return boxes / scale, scores
