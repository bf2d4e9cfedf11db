"""Layout of one video frame: 1280 x 720."""

from __future__ import annotations

from helios_core import proto as pb

from helios_eval.video.camera_panel import camera_picture
from helios_eval.video.decision_panel import decisions_picture
from helios_eval.video.drawing import (
    BLUE,
    GREEN,
    INK,
    LINE,
    MUTED,
    PAPER,
    RED,
    WHITE,
    Picture,
    Rgb,
    Sheet,
    clean,
    tinted,
    width_of,
    wrapped,
)
from helios_eval.video.frame_content import ROLE_COLOR, Scene
from helios_eval.video.map_panel import (
    FRONTIER_RGB,
    PATH_RGB,
    TRAIL_RGB,
    map_picture,
    value_range,
)

WIDTH, HEIGHT = 1280, 720
HEAD = 84
GAP = 14
# Left edges and widths of the three columns.
CAMERA_X, CAMERA_W = GAP, 350
MAP_X, MAP_W = CAMERA_X + CAMERA_W + GAP, 468
WHY_X, WHY_W = MAP_X + MAP_W + GAP, WIDTH - GAP - (MAP_X + MAP_W + GAP)
TOP = HEAD + GAP
BOTTOM = HEIGHT - GAP
TITLE = 30  # height of a panel's title
PAD = 12
CAMERA_H = 430  # maximum
VALUE_H = 176
STORY_LINE = 12 * 1.4

PHASES = {
    "find_object": "find object",
    "pick": "pick",
    "find_receptacle": "find receptacle",
    "place": "place",
}
END_COLORS = {"succeeded": GREEN, "failed": RED, "cancelled": MUTED}


def frame_picture(scene: Scene) -> Picture:
    """Video frame of a scene, RGB [720, 1280, 3]."""
    sheet = Sheet.blank(WIDTH, HEIGHT, PAPER)
    _head(sheet, scene)
    _camera(sheet, scene)
    _status(sheet, scene)
    _map(sheet, scene)
    _values(sheet, scene)
    _decision(sheet, scene)
    return sheet.pixels


# --- head ---------------------------------------------------------------------------------------
def _head(sheet: Sheet, scene: Scene) -> None:
    sheet.box(-1, -1, WIDTH, HEAD, WHITE, radius=0)
    sheet.rule(0, HEAD, WIDTH)
    side = sheet.text(WIDTH - GAP - 4, 26, scene.title, 420, 12, MUTED, align="r")
    asked = scene.task.instruction or "no task yet"
    sheet.text(GAP + 4, 26, asked, WIDTH - side - 4 * GAP, 20, INK, bold=True)
    x = GAP + 4.0
    if scene.task.kind in ("", "move"):
        x = _phases(sheet, x, 60, scene.task)
    else:
        name = PHASES.get(scene.task.phase, scene.task.phase) or scene.task.kind
        x += sheet.pill(x, 60, name, 300, 13, BLUE) + 8
    _outcome(sheet, x + 10, 60, scene)


def _phases(sheet: Sheet, x: float, y: float, task: pb.Task) -> float:
    order = list(PHASES)
    now = order.index(task.phase) if task.phase in order else -1
    done_all = task.state == "succeeded"
    for k, name in enumerate(PHASES.values()):
        if done_all or k < now:
            name = f"✓ {name}"
            fill, color, line = tinted(GREEN, 0.16), GREEN, tinted(GREEN, 0.4)
        elif k == now:
            fill = END_COLORS.get(task.state, BLUE)
            color, line = WHITE, fill
        else:
            fill, color, line = WHITE, MUTED, LINE
        x += sheet.pill(x, y, name, 200, 13, fill, color, line) + 4
        if k < len(order) - 1:
            x += sheet.text(x + 2, y, "›", 20, 15, MUTED) + 8
    return x


def _outcome(sheet: Sheet, x: float, y: float, scene: Scene) -> None:
    right = WIDTH - GAP - 4
    steps = f"step {scene.step}"
    if scene.task.max_steps:
        steps += f" of {scene.task.max_steps}"
    right -= sheet.text(right, y, steps, 160, 13, INK, align="r") + 16
    if scene.task.state in END_COLORS:
        text = scene.task.state
        if scene.task.cause:
            text += f": {scene.task.cause}"
        x += sheet.pill(
            x, y, text, max(60.0, right - x), 13, END_COLORS[scene.task.state], bold=True
        )
        x += 12
    if scene.verdict and right - x > 60:
        color = GREEN if scene.right else RED
        sheet.pill(x, y, scene.verdict, right - x, 13, tinted(color, 0.13), color, color)


# --- columns ------------------------------------------------------------------------------------
def _panel(
    sheet: Sheet, x: int, y: int, w: int, h: int, title: str, note: str = ""
) -> tuple[int, int, int, int]:
    """Draw a white panel; return x, y, width, height of its content area below the title."""
    sheet.box(x, y, x + w, y + h, WHITE, LINE)
    took = sheet.text(x + PAD, y + TITLE / 2 + 1, title, w - 2 * PAD, 12, INK, bold=True)
    if note:
        room = w - 2 * PAD - took - 12
        sheet.text(x + w - PAD, y + TITLE / 2 + 1, note, room, 11, MUTED, align="r")
    return x + 1, y + TITLE, w - 1, h - TITLE


def _camera(sheet: Sheet, scene: Scene) -> None:
    count = len(scene.detections)
    note = "nothing detected" if not count else f"{count} detection{'s' * (count > 1)}"
    x, y, w, h = _panel(
        sheet,
        CAMERA_X,
        TOP,
        CAMERA_W,
        _camera_height(scene),
        "Camera",
        note if scene.color is not None else "",
    )
    sheet.paste(camera_picture(scene, w - PAD, h - PAD // 2), x + PAD // 2, y)


def _camera_height(scene: Scene) -> int:
    """Height of the camera's panel, as its image needs."""
    if scene.color is None:
        return CAMERA_H
    rows, columns = scene.color.shape[:2]
    wanted = TITLE + PAD // 2 + round((CAMERA_W - 1 - PAD) * rows / columns)
    return max(CAMERA_H // 2, min(CAMERA_H, wanted))


def _status(sheet: Sheet, scene: Scene) -> None:
    top = TOP + _camera_height(scene) + GAP
    x, y, w, h = _panel(sheet, CAMERA_X, top, CAMERA_W, BOTTOM - top, "Now")
    task = scene.task
    rows: list[tuple[str, str, Rgb]] = [
        ("seeks", task.seeking or "–", scene.color_of(task.seeking) if task.seeking else MUTED),
        ("holds", scene.held or "nothing", INK if scene.held else MUTED),
    ]
    if scene.map is not None:
        rows.append(("knows", f"{scene.map.explored_m2:.0f} m² of floor", INK))
    for k, (name, text, color) in enumerate(rows):
        sheet.text(x + PAD, y + 9 + 22 * k, name, 52, 12, MUTED)
        sheet.text(x + PAD + 54, y + 9 + 22 * k, text, w - 2 * PAD - 54, 13, color, bold=k < 2)
    below = y + 3.0 + 22 * len(rows)
    sheet.rule(x + PAD, below, x + w - PAD)
    below += 6
    end = y + h - 6
    for k, (step, text) in enumerate(reversed(scene.story)):  # newest first
        lines = wrapped(text, w - 2 * PAD - 40, 12, 3)
        took = STORY_LINE * len(lines)
        if below + took > end:
            if k or below + STORY_LINE > end:
                break
            lines = wrapped(text, w - 2 * PAD - 40, 12, int((end - below) // STORY_LINE))
        color = MUTED if k else INK
        sheet.text(x + PAD + 30, below + STORY_LINE / 2, str(step), 34, 11, MUTED, align="r")
        sheet.paragraph(x + PAD + 40, below, text, w - 2 * PAD - 40, len(lines), 12, color)
        below += took + 5


def _map(sheet: Sheet, scene: Scene) -> None:
    bottom = BOTTOM - VALUE_H - GAP
    x, y, w, h = _panel(sheet, MAP_X, TOP, MAP_W, bottom - TOP, "Map")
    _legend(sheet, x + 46, TOP + TITLE // 2 + 1, x + w - PAD, scene)
    sheet.paste(map_picture(scene, w - PAD, h - PAD // 2), x + PAD // 2, y)


def _legend(sheet: Sheet, x: float, y: float, right: float, scene: Scene) -> None:
    """Draw the legend up to the right edge, with as many of the first entries as fit."""
    entries = [("frontier", FRONTIER_RGB), ("plan", PATH_RGB), ("way so far", TRAIL_RGB)]
    named = {role: name for name, role in scene.roles.items()}
    entries += [(clean(named[role])[:18], c) for role, c in ROLE_COLOR.items() if role in named]
    wide = [width_of(name, 11) + 24 for name, _ in entries]
    while entries and sum(wide) > right - x:
        entries.pop()
        wide.pop()
    at = right + 9 - sum(wide)
    for (name, color), step in zip(entries, wide, strict=True):
        sheet.box(at, y - 4, at + 8, y + 4, color, radius=4)
        sheet.text(at + 12, y, name, step, 11, MUTED)
        at += step


def _values(sheet: Sheet, scene: Scene) -> None:
    layers = sorted(scene.map.values)[:2] if scene.map is not None else []
    w = (MAP_W - GAP) // 2
    for k in range(2):
        left, top = MAP_X + k * (w + GAP), BOTTOM - VALUE_H
        if k >= len(layers) or scene.map is None:
            _panel(sheet, left, top, w, VALUE_H, "Value", "none yet")
            continue
        low, high = value_range(scene.map, layers[k])
        note = f"{low:.2f} – {high:.2f}" if high else ""
        x, y, inner, h = _panel(sheet, left, top, w, VALUE_H, f"Value: {layers[k]}", note)
        picture = map_picture(scene, inner - PAD, h - PAD // 2, layers[k])
        sheet.paste(picture, x + PAD // 2, y)


def _decision(sheet: Sheet, scene: Scene) -> None:
    x, y, w, h = _panel(sheet, WHY_X, TOP, WHY_W, BOTTOM - TOP, "Decisions", "the newest first")
    sheet.rule(x + PAD, y - 1, x + w - PAD)
    picture = decisions_picture(scene.decisions, w - 2 * PAD, h - PAD - 6)
    sheet.paste(picture, x + PAD, y + 6)
