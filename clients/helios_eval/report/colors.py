"""Colours of the report, safe for colour-blind readers (Okabe and Ito; Tol's "muted").

Drawings use the light colours. In the page each colour becomes a CSS variable, so that one drawing
suits light mode, dark mode and print.
"""

from __future__ import annotations

from dataclasses import dataclass

from helios_sim.failure_causes import CAUSES

from helios_eval import palette

SUCCESS = "success"


@dataclass(frozen=True)
class Colour:
    name: str  # name of the CSS variable
    light: str
    dark: str


INK = Colour("ink", palette.INK, "#e7ebf0")
MUTED = Colour("muted", palette.MUTED, "#9aa6b3")
LINE = Colour("line", palette.GRID, "#343d49")
PAPER = Colour("paper", "#ffffff", "#151a21")

_CAUSE_COLOURS: dict[str, Colour] = dict(
    zip(
        (SUCCESS, *CAUSES),
        (
            Colour("c-success", "#117734", "#2a8a4c"),
            Colour("c-object", "#88ccee", "#88ccef"),
            Colour("c-receptacle", "#44aa99", "#45ab9a"),
            Colour("c-wrong", "#ddcc77", "#decd78"),
            Colour("c-pick", "#999933", "#a5a53d"),
            Colour("c-collision", "#cc6677", "#d9778a"),
            Colour("c-place", "#aa4499", "#c565b5"),
            Colour("c-rolled", "#882255", "#a83a70"),
            Colour("c-stuck", "#8a8f98", "#8b9099"),
            Colour("c-budget", "#332288", "#6a5fd0"),
            Colour("c-system", "#222831", "#f2f4f7"),
        ),
        strict=True,
    )
)
_OTHER = Colour("c-other", "#b9bec6", "#6c7480")

SERIES = (
    Colour("s-0", palette.BLUE, "#4da6e0"),
    Colour("s-1", palette.VERMILION, "#f08a3c"),
    Colour("s-2", palette.GREEN, "#2fc79b"),
    Colour("s-3", palette.PINK, "#dd93bd"),
    Colour("s-4", "#7a6a00", "#d8c545"),
    Colour("s-5", palette.SKY, "#86cdf5"),
    Colour("s-6", "#4b3a8f", "#9c8be0"),
    Colour("s-7", palette.GREY, "#a3a8b0"),
)

ALL = (INK, MUTED, LINE, PAPER, *_CAUSE_COLOURS.values(), _OTHER, *SERIES)


def of_cause(cause: str) -> Colour:
    """Colour of a cause; "" is success."""
    return _CAUSE_COLOURS.get(cause or SUCCESS, _OTHER)


def is_dark(colour: Colour) -> bool:
    """True if white text is more legible than black text on the colour."""
    r, g, b = (int(colour.light[i : i + 2], 16) for i in (1, 3, 5))
    return 0.299 * r + 0.587 * g + 0.114 * b < 128


def with_variables(svg: str) -> str:
    """The drawing with each known colour replaced by its CSS variable."""
    for colour in ALL:
        svg = svg.replace(colour.light, f"var(--{colour.name})")
    return svg


def css_variables(dark: bool) -> str:
    """Declarations of the CSS variables."""
    return "".join(f"--{c.name}:{c.dark if dark else c.light};" for c in ALL)
