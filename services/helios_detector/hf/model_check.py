"""End-to-end check of models on one image with their real weights.

    python -m helios_detector.hf.model_check \
        --detector transformers:IDEA-Research/grounding-dino-tiny \
        --masks transformers:facebook/sam2.1-hiera-small --classes "mug,table=0.35" --image room.jpg

It prints the results, the time per frame and the memory use, and writes an image with boxes and
masks beside the input. Exit status 0 if all named models work.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from helios_core.atomic_file import write_file
from helios_core.errors import HeliosError, InvalidInput
from helios_core.geometry import Pinhole, camera_on_base
from helios_core.types import Frame, FrameId, Role, SearchClass, SearchContext
from numpy.typing import NDArray

from helios_detector.backend import DetectorOptions, Findings, Seen
from helios_detector.memory_usage import resident_mb
from helios_detector.model_loading import open_depth, open_detector, open_scorer

T = TypeVar("T")
CAMERA_M = 1.3  # height of the camera, which points horizontally along world x
FLAT_M = 2.0  # depth of every pixel without a depth model


def main(argv: list[str] | None = None) -> int:
    args = _arguments().parse_args(argv)
    try:
        _check(args)
    except HeliosError as error:
        print(f"check: {error.message}", file=sys.stderr)
        return 2 if isinstance(error, InvalidInput) else 1
    return 0


def _check_depth(
    args: argparse.Namespace,
    options: DetectorOptions,
    color: NDArray[np.uint8],
    focal_px: float,
) -> tuple[NDArray[np.float32], float] | None:
    """Depth in metres [h, w] and focal length by the depth model; None if there is no model.

    focal_px: for a model that does not estimate it.
    """
    model = open_depth(args.depth, options, args.depth_focal)
    if model is None:
        return None
    given = args.focal_px or (None if args.depth_focal == "own" else focal_px)
    made = _timed(
        "depth",
        model.name,
        model.warm_up,
        model.accelerator_mb,
        lambda: model.estimate(color, given),
        args.repeat,
    )
    good = made.depth_m[made.depth_m > 0]
    spread = np.percentile(good, [5, 50, 95]) if good.size else [0, 0, 0]
    print(
        f"  metres at 5, 50, 95 %: {', '.join(f'{v:.2f}' for v in spread)}; "
        f"focal length {made.focal_px:.0f} px"
    )
    return made.depth_m, made.focal_px


def _check_scorer(
    args: argparse.Namespace, options: DetectorOptions, frame: Frame, seen: tuple[Seen, ...]
) -> None:
    scorer = open_scorer(args.scorer, options)
    prompts = {p: p for p in args.prompt or ["Seems like there is a mug ahead"]}
    scores = _timed(
        "scorer",
        scorer.name,
        scorer.warm_up,
        scorer.accelerator_mb,
        lambda: scorer.score(frame, seen, prompts),
        args.repeat,
    )
    for prompt, score in scores.items():
        print(f"  {score:.3f}  {prompt}")


def _check(args: argparse.Namespace) -> None:
    if args.repeat < 1:
        raise InvalidInput(f"--repeat is {args.repeat}; set 1 or more")
    if not (args.detector or args.scorer or args.depth):
        raise InvalidInput("nothing to check; name --detector, --scorer or --depth")
    options = DetectorOptions(
        threads=args.threads,
        device=args.device,
        precision=args.precision,
        masks=args.masks,
        score_head=args.score_head,
    )
    color = _read(args.image)
    height, width = color.shape[:2]
    focal_px = args.focal_px or 0.5 * width / np.tan(np.deg2rad(30))
    depth_m = np.full((height, width), FLAT_M, np.float32)
    if args.depth:
        depth_m, focal_px = _check_depth(args, options, color, focal_px) or (depth_m, focal_px)
    camera = Pinhole(focal_px, focal_px, width / 2, height / 2, width, height)
    T_world_cam = camera_on_base(np.eye(4), CAMERA_M, 0.0)
    frame = Frame(FrameId("check", 0, 1), 0, True, color, depth_m, camera, T_world_cam, np.eye(4))
    findings = Findings((), ())
    if args.detector:
        detector = open_detector(args.detector, options)
        context = SearchContext("check", _classes(args.classes))
        findings = _timed(
            "detector",
            detector.name,
            detector.warm_up,
            detector.accelerator_mb,
            lambda: detector.detect(frame, context),
            args.repeat,
        )
        for d in findings.detections:
            print(f"  {d.class_name} {d.score:.2f} box {d.box_xyxy} mask {int(d.mask.sum())} px")
    if args.scorer:
        _check_scorer(args, options, frame, findings.seen)
    if args.detector:
        out = args.out or args.image.with_name(f"{args.image.stem}-checked.png")
        coded, picture = cv2.imencode(out.suffix, drawn(color, findings)[..., ::-1])
        assert coded
        write_file(out, picture.tobytes())
        print(f"picture: {out}")


def drawn(color: NDArray[np.uint8], findings: Findings) -> NDArray[np.uint8]:
    """The image with tinted masks and labelled boxes."""
    out = color.copy()
    for i, d in enumerate(findings.detections):
        hue = np.array([[[(i * 47) % 180, 200, 255]]], np.uint8)
        tint = cv2.cvtColor(hue, cv2.COLOR_HSV2RGB)[0, 0]
        out[d.mask] = (0.5 * out[d.mask] + 0.5 * tint).astype(np.uint8)
        x0, y0, x1, y1 = d.box_xyxy
        cv2.rectangle(out, (x0, y0), (x1 - 1, y1 - 1), tint.tolist(), 2)
        label, at = f"{d.class_name} {d.score:.2f}", (x0 + 2, max(12, y0 - 4))
        cv2.putText(out, label, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 3)
        cv2.putText(out, label, at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, tint.tolist(), 1)
    return out


def _timed(
    what: str,
    name: str,
    warm_up: Callable[[], None],
    accelerator_mb: Callable[[], float],
    work: Callable[[], T],
    repeat: int,
) -> T:
    began, before = time.perf_counter(), resident_mb()
    warm_up()
    loaded_s = time.perf_counter() - began
    times, result = [], None
    for _ in range(repeat):
        began = time.perf_counter()
        result = work()
        times.append((time.perf_counter() - began) * 1e3)
    peak = accelerator_mb()
    on_card = f", {peak:.0f} MB on the accelerator" if peak else ""
    print(
        f"{what} {name}: works; {loaded_s:.1f} s to load and warm up, "
        f"{statistics.median(times):.0f} ms a frame (median of {repeat}), "
        f"{resident_mb() - before:.0f} MB more memory{on_card}"
    )
    assert result is not None
    return result


def _read(path: Path) -> NDArray[np.uint8]:
    bgr = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if bgr is None:
        raise InvalidInput(f"{path} is no image that can be read; name a JPEG or PNG")
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def _classes(text: str) -> tuple[SearchClass, ...]:
    """Classes from text such as `mug,table=0.35`: name and detector threshold, 0.25 by default."""
    out = []
    for part in filter(None, (p.strip() for p in text.split(","))):
        name, _, threshold = part.partition("=")
        try:
            value = float(threshold or 0.25)
        except ValueError as error:
            raise InvalidInput(f"--classes has {part!r}; write NAME or NAME=0.35") from error
        out.append(SearchClass(name.strip(), Role.OBJECT, value))
    if not out:
        raise InvalidInput('--classes names nothing; write --classes "mug,table=0.35"')
    return tuple(out)


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m helios_detector.hf.model_check",
        description="Check models on one image, with downloaded weights or those of a folder.",
    )
    parser.add_argument("--image", type=Path, required=True)
    parser.add_argument("--detector", default="", help="transformers:ID, onnx:FILE, …")
    parser.add_argument("--classes", default="mug,table", help="NAME or NAME=THRESHOLD, by comma")
    parser.add_argument("--masks", default="depth", help="depth, or transformers:ID of a SAM 2")
    parser.add_argument("--scorer", default="", help="lexical, minilm or transformers:ID")
    parser.add_argument("--score-head", default="itc", help="of BLIP-2: itc or itm")
    parser.add_argument("--prompt", action="append", help="may be given several times")
    parser.add_argument("--depth", default="", help="transformers:ID")
    parser.add_argument("--depth-focal", default="calibrated", help="calibrated or own")
    parser.add_argument("--focal-px", type=float, default=0.0, help="0: of a 60 degree camera")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--precision", default="auto")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeat", type=int, default=5, help="frames to time")
    parser.add_argument("--out", type=Path, help="the picture; default beside the image")
    return parser


if __name__ == "__main__":
    sys.exit(main())
