"""Panel of the last decisions: rule, reason, and a table of the candidates with their terms."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence

from helios_core import proto as pb

from helios_eval.video.drawing import BLUE, INK, MUTED, WHITE, Picture, Sheet, cut, tinted

# Terms in order of importance, with their titles in the table.
TERMS = {
    "score": "Ψ",
    "class_score": "S",
    "score_after_view": "Ψ′",
    "information_gain": "gain",
    "value": "value",
    "views": "views",
    "distance_m": "dist.",
    "uncertainty": "U",
    "total": "total",
}
KIND = {"object": "thing", "receptacle": "place", "frontier": "frontier", "gaze": "view"}
MOST_COLUMNS = 5
ROW_PX = 25
MOST_ROWS = 16
LEAST_PX = 150  # least height of an older decision
COLUMN_PX = 47
MARK_PX = 18


def decisions_picture(decisions: Sequence[pb.Decision], width: int, height: int) -> Picture:
    """RGB [height, width, 3]: the newest decision (last in the list) on top, older ones below."""
    sheet = Sheet.blank(width, height, WHITE)
    if not decisions:
        sheet.text(0, 12, "no decision yet", width, 13, MUTED)
    top = 0.0
    for decision in reversed(decisions):
        if top and height - top < LEAST_PX:
            break
        if top:
            sheet.rule(0, top, width)
            top += 8
        top = _block(sheet, top, width, height, decision, newest=top == 0.0) + 10
    return sheet.pixels


def _block(
    sheet: Sheet, top: float, width: int, bottom: float, decision: pb.Decision, newest: bool
) -> float:
    """Draw one decision from `top` downwards; return its lower end."""
    sheet.text(width, top + 10, f"#{decision.index + 1}", 80, 12, MUTED, align="r")
    sheet.text(
        0,
        top + 10,
        _sentence(decision.rule),
        width - 90,
        15 if newest else 13,
        INK if newest else MUTED,
        bold=True,
    )
    y = top + 25
    y += sheet.paragraph(0, y, _sentence(decision.why), width, 3, 12, INK if newest else MUTED)
    settings = " · ".join(f"{k} {v:.3g}" for k, v in sorted(decision.settings.items()))
    if settings:
        sheet.text(0, y + 9, settings, width, 11, MUTED)
        y += 18
    most = int((bottom - y - 6) // ROW_PX) - 1
    if most < 1 or not decision.candidates:
        return y
    return _table(sheet, y + 6, width, min(most, MOST_ROWS), decision)


def columns_of(
    candidates: Sequence[pb.Candidate], settings: Container[str] = frozenset()
) -> list[str]:
    """At most five terms to show; `total`, which decides, is the last.

    Terms among the rule's settings are left out, since they are equal for all candidates.
    """
    known = {name for c in candidates for name in c.terms if name not in settings}
    order = [name for name in TERMS if name in known]
    order += sorted(known - TERMS.keys())
    if _same(candidates, "total", "score") or _same(candidates, "total", "score_after_view"):
        order.remove("total")
    if "total" in order:
        order.remove("total")
        return [*order[: MOST_COLUMNS - 1], "total"]
    return order[:MOST_COLUMNS]


def rows_of(candidates: Sequence[pb.Candidate], most: int) -> list[pb.Candidate]:
    """The best candidates by total; the chosen one is always among them."""
    ranked = sorted(candidates, key=lambda c: (not c.chosen, -_ranked(c.terms.get("total"))))
    shown = ranked[: max(1, most)]
    return sorted(shown, key=lambda c: -_ranked(c.terms.get("total")))


def _table(sheet: Sheet, top: float, width: int, most: int, decision: pb.Decision) -> float:
    """Draw the candidates in at most `most` lines below a header; return the lower end."""
    candidates = decision.candidates
    if len(candidates) > most > 1:
        most -= 1  # for the line with the number of further candidates
    rows, columns = rows_of(candidates, most), columns_of(candidates, decision.settings)
    deciding = "total" if "total" in columns else columns[0] if columns else ""
    left = width - COLUMN_PX * len(columns)
    y = top + ROW_PX / 2
    sheet.text(MARK_PX, y, "candidate", left - MARK_PX, 11, MUTED)
    for k, name in enumerate(columns):
        sheet.text(
            left + (k + 1) * COLUMN_PX - 4,
            y,
            TERMS.get(name, name),
            COLUMN_PX - 6,
            11,
            MUTED,
            align="r",
        )
    sheet.rule(0, top + ROW_PX - 1, width)
    for c in rows:
        y += ROW_PX
        if c.chosen:
            half = ROW_PX / 2
            sheet.box(0, y - half + 1, width, y + half - 2, tinted(BLUE, 0.13), radius=5)
            sheet.box(6, y - 3, 12, y + 3, BLUE, radius=3)
        _row(sheet, y, left, c, columns, deciding)
    if len(rows) < len(candidates):
        y += ROW_PX
        sheet.text(MARK_PX, y, f"and {len(candidates) - len(rows)} more", width, 11, MUTED)
    return y + ROW_PX / 2


def _row(
    sheet: Sheet, y: float, left: float, c: pb.Candidate, columns: Sequence[str], deciding: str
) -> None:
    name = c.name or KIND.get(c.kind, c.kind)
    kind = KIND.get(c.kind, c.kind)
    room = left - MARK_PX - 8
    took = sheet.text(MARK_PX, y, name, room, 12, INK, bold=c.chosen)
    if kind not in name and room - took > 40:
        sheet.text(MARK_PX + took + 7, y, kind, room - took - 7, 10, MUTED)
    for k, term in enumerate(columns):
        if term in c.terms:
            best = term == deciding
            text = cut(number(c.terms[term]), COLUMN_PX - 6, 12)
            sheet.text(
                left + (k + 1) * COLUMN_PX - 4,
                y,
                text,
                COLUMN_PX - 6,
                12,
                INK if best or c.chosen else MUTED,
                bold=best and c.chosen,
                align="r",
            )


def number(value: float) -> str:
    """Text of at most five characters for a number of ordinary size."""
    if not math.isfinite(value):
        return "–" if math.isnan(value) else ("∞" if value > 0 else "−∞")
    size = abs(value)
    if size >= 99_995:
        text = f"{value:.0e}".replace("e+0", "e").replace("e+", "e")
    elif size >= 99.95 or value == int(value):
        text = f"{value:.0f}"
    elif size >= 9.995:
        text = f"{value:.1f}"
    else:
        text = f"{value:.2f}" if size >= 0.095 else f"{value:.3f}"
    return text.replace("-", "−")


def _same(candidates: Sequence[pb.Candidate], one: str, other: str) -> bool:
    return all(
        one in c.terms and other in c.terms and c.terms[one] == c.terms[other] for c in candidates
    )


def _ranked(total: float | None) -> float:
    return total if total is not None and not math.isnan(total) else -math.inf


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
