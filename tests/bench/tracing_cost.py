"""Processor time of tracing, as a share of a step: python -m tests.bench.tracing_cost

One task is played in a simulated home with tracing on. The processor time of all services and the
number of spans give the cost of a step and its spans. The cost of a span is measured beside it in
one process: the span with its attributes and context, the attachment that is sent and read, and
the export to a receiver in another process. All times are processor times (user and system), so
other load on the machine changes them little.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
from helios_core import tracing
from helios_core.span_recording import SpanRecording
from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
from opentelemetry.sdk.trace.export import BatchSpanProcessor

from tests.helios_up import helios_up
from tests.support import LOOPBACK, free_port, wait_until

SPANS, ROUNDS = 2000, 9
ENDED = ("succeeded", "failed", "cancelled")
RECEIVER = """
import sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
class Handler(BaseHTTPRequestHandler):
    def do_POST(self):
        self.rfile.read(int(self.headers["content-length"]))
        self.send_response(200); self.end_headers()
    def log_message(self, *a): pass
ThreadingHTTPServer(("127.0.0.1", int(sys.argv[1])), Handler).serve_forever()
"""


def span_us(recording: SpanRecording | None) -> float:
    """Processor time of one piece of work with a message, microseconds; None: tracing is off."""
    tracing.use(recording)
    began_s = time.process_time()
    for number in range(SPANS):
        with tracing.span("work", task="c0ffee", keyframe=f"a1b2c3/0/{number}", action="forward"):
            attached = tracing.attachment()
        with tracing.received(attached):
            pass
    if recording is not None:
        recording._provider.force_flush()
    return (time.process_time() - began_s) / SPANS * 1e6


def span_costs() -> dict[str, float]:
    """Median cost of a span, in microseconds: off, kept in memory, and exported."""
    port = free_port()
    receiver = subprocess.Popen([sys.executable, "-c", RECEIVER, str(port)])
    try:
        endpoint = f"http://127.0.0.1:{port}/v1/traces"
        batch = BatchSpanProcessor(OTLPSpanExporter(endpoint), max_queue_size=2 * SPANS)
        kinds = {
            "off": None,
            "kept": SpanRecording("bench", "r"),
            "exported": SpanRecording("bench", "r", (batch,)),
        }
        time.sleep(1.0)  # the receiver starts
        took: dict[str, list[float]] = {name: [] for name in kinds}
        for _ in range(ROUNDS):  # in turns
            for name, recording in kinds.items():
                took[name].append(span_us(recording))
    finally:
        tracing.use(None)
        receiver.kill()
        receiver.wait()
    return {name: statistics.median(values) for name, values in took.items()}


def step_cost(instruction: str, seed: int) -> tuple[float, float]:
    """(processor time of all services per step in ms, spans per step) of one traced task."""
    flags = ("--robot", "sim", "--seed", str(seed), "--tracing")
    with tempfile.TemporaryDirectory() as state, helios_up(Path(state), *flags) as up:
        wait_until(up.ready, 600, "all services are ready")
        services = psutil.Process(up.process.pid).children(recursive=True)
        before_s = _cpu_s(services)
        task = LOOPBACK.post(f"{up.address}/v1/tasks", json={"instruction": instruction}).json()
        path = f"{up.address}/v1/tasks/{task['id']}"
        wait_until(lambda: LOOPBACK.get(path).json()["state"] in ENDED, 1200, "it has ended")
        used_s = _cpu_s(services) - before_s
        ended = LOOPBACK.get(path).json()
        spans = LOOPBACK.get(f"{path}/trace", timeout=60).json()["spans"]
    return used_s * 1e3 / ended["steps"], len(spans) / ended["steps"]


def _cpu_s(processes: list[psutil.Process]) -> float:
    return sum(sum(process.cpu_times()[:2]) for process in processes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    os.environ.setdefault("MUJOCO_GL", "egl")
    costs = span_costs()
    step_ms, spans = step_cost("Move the can from the nightstand to the side table", given.seed)
    shares = {
        name: spans * (cost - costs["off"]) / 1e3 / step_ms
        for name, cost in costs.items()
        if name != "off"
    }
    out = {"step_ms": step_ms, "spans_per_step": spans, "span_us": costs, "share": shares}
    print(json.dumps(out, indent=1))
    if given.json is not None:
        given.json.write_text(json.dumps(out, indent=1))


if __name__ == "__main__":
    main()
