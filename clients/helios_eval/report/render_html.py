"""Renderer of the report as one HTML file without external resources."""

from __future__ import annotations

import base64
from importlib import resources

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from helios_eval.report import colors
from helios_eval.report.report_model import Report


def html_of(report: Report) -> str:
    """HTML page; the template escapes all external text."""
    environment = Environment(
        loader=PackageLoader("helios_eval.report", "page"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= {
        "kind": lambda block: type(block).__name__,
        "base64": lambda data: base64.b64encode(data).decode("ascii"),
        "unbroken": lambda words: Markup(" ").join(
            Markup("<span>{}</span>").format(word) for word in words.split(" ")
        ),
        "cause_colour": lambda cause: colors.of_cause(cause).name,
    }
    page = resources.files("helios_eval.report") / "page"
    return environment.get_template("report.html.j2").render(
        report=report,
        light=Markup(colors.css_variables(dark=False)),
        dark=Markup(colors.css_variables(dark=True)),
        css=Markup((page / "report.css").read_text(encoding="utf-8")),
        script=Markup((page / "report.js").read_text(encoding="utf-8")),
    )
