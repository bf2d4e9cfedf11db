"""Tests that dashboards and alert rules name metrics and figures that exist."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from helios_gateway.fleet.queue import FleetQueue
from helios_gateway.prometheus_metrics import Metrics
from helios_gateway.robot_registry import RobotRegistry

yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "deploy/observability"
DASHBOARD: dict[str, Any] = json.loads((FOLDER / "grafana/helios.json").read_text())
ALERTS: list[dict[str, Any]] = yaml.safe_load((FOLDER / "alerts.yml").read_text())["groups"][0][
    "rules"
]
EXPRESSIONS = [
    *(t["expr"] for panel in DASHBOARD["panels"] for t in panel["targets"]),
    *(rule["expr"] for rule in ALERTS),
]
OF_PROMETHEUS = {"up"}


@cache
def metric_names() -> set[str]:
    """Names of all series that the gateway serves."""
    metrics = Metrics(RobotRegistry({}), FleetQueue(None))
    out: set[str] = set()
    for family in metrics.registry.collect():
        suffixes = {"counter": ("_total",), "histogram": ("_bucket", "_sum", "_count")}
        out |= {family.name + s for s in suffixes.get(family.type, ("",))}
    return out


@cache
def figure_names() -> set[str]:
    """Names of the figures that the services publish, as their code writes them."""
    out: set[str] = set()
    for path in [*ROOT.glob("services/**/*.py"), *ROOT.glob("clients/helios_sim/**/*.py")]:
        for kind, name in re.findall(
            r"\b(sample|count|set)\(\s*\"([a-z_0-9]+)\"", path.read_text()
        ):
            out.add(f"{name}_median" if kind == "sample" else name)
    return out


@pytest.mark.parametrize("expression", EXPRESSIONS)
def test_each_expression_uses_metrics_that_the_gateway_serves(expression: str) -> None:
    without_strings = re.sub(r'"[^"]*"', "", expression)
    used = set(re.findall(r"\b(helios_\w+|up)\b(?=[{\[ )])", without_strings + " "))
    assert used
    assert used <= metric_names() | OF_PROMETHEUS


@pytest.mark.parametrize("expression", EXPRESSIONS)
def test_each_figure_is_one_that_a_service_publishes(expression: str) -> None:
    assert set(re.findall(r'name="([^"]*)"', expression)) <= figure_names()


def test_a_wrong_metric_would_be_found() -> None:
    assert "helios_redy" not in metric_names()
    assert "helios_ready" in metric_names()
    assert "update_ms_median" in figure_names()


@pytest.mark.parametrize("rule", ALERTS, ids=lambda rule: rule["alert"])
def test_each_alert_says_what_is_wrong(rule: dict[str, Any]) -> None:
    assert rule["annotations"]["summary"].endswith(".") or rule["annotations"]["summary"][-1] == "?"
    assert rule["labels"]["severity"] in ("warning", "critical")


@pytest.mark.parametrize("rule", ALERTS, ids=lambda rule: rule["alert"])
def test_no_alert_names_a_command_that_works_on_the_robots_machine_alone(
    rule: dict[str, Any],
) -> None:
    assert "helios logs" not in rule["annotations"]["summary"]


def test_the_compose_file_mounts_files_that_exist() -> None:
    compose = yaml.safe_load((ROOT / "deploy/compose.observability.yaml").read_text())
    for service in compose["services"].values():
        for volume in service.get("volumes", ()):
            source = volume.split(":")[0]
            if source.startswith("."):
                assert (ROOT / "deploy" / source).is_file(), source
            else:
                assert source in compose["volumes"]


def test_every_service_exports_to_the_receiver_of_the_compose_file() -> None:
    services = yaml.safe_load((ROOT / "deploy/compose.yaml").read_text())["services"]
    beside = yaml.safe_load((ROOT / "deploy/compose.observability.yaml").read_text())["services"]
    for name in services.keys() - {"router"}:
        assert beside[name]["environment"] == {"OTEL_EXPORTER_OTLP_ENDPOINT": "http://jaeger:4318"}
    assert "jaeger" in beside
