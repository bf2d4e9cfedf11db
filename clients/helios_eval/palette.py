"""Colours of charts: the palette of Okabe and Ito, safe for colour-blind readers, and greys."""

from __future__ import annotations

BLUE = "#0072b2"
VERMILION = "#d55e00"
GREEN = "#009e73"
PINK = "#cc79a7"
ORANGE = "#e69f00"
SKY = "#56b4e9"

INK = "#1c2430"  # text and data of one series
MUTED = "#5d6875"  # text of less weight
GREY = "#6b6f76"  # a series for comparison
GRID = "#d9dee5"
