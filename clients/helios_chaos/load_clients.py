"""Clients that load a gateway: `python -m helios_chaos.load_clients PORT`, until SIGTERM.

Dashboards hold an event stream each; one more client opens a stream and never reads. A pool of
connections asks for mixed reads at a fixed rate. Prints its counts as JSON at the end.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import json
import signal
import socket
import time
from collections import Counter
from dataclasses import dataclass, field

from helios_chaos.figures import percentiles

DASHBOARDS, REQUESTS_PER_S, CONNECTIONS = 50, 200, 40
READS = (
    "/v1/status", "/v1/robot", "/v1/tasks", "/v1/map", "/v1/objects", "/v1/map/frontiers",
    "/v1/camera.jpg", "/readyz", "/v1/map/occupancy.png", "/metrics",
)  # fmt: skip


@dataclass
class Counts:
    """What the clients got."""

    events: int = 0
    requests: int = 0
    failures: Counter[str] = field(default_factory=Counter)  # "status path" -> requests
    late: int = 0  # requests not sent, as all connections were busy
    latency_ms: list[float] = field(default_factory=list)


async def watch(port: int, counts: Counts, read: bool) -> None:
    """One event stream, read or not; opened again when it ends."""
    while True:
        try:
            if not read:
                await _be_deaf(port)
            reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 22)
            writer.write(b"GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
            async for line in reader:
                counts.events += line.startswith(b"event: ")
        except (OSError, ValueError):
            pass
        await asyncio.sleep(0.5)


async def _be_deaf(port: int) -> None:
    """Ask for events and read none; the gateway soon cannot send more."""
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(("127.0.0.1", port))
        connection.sendall(b"GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        await asyncio.Event().wait()


async def ask(port: int, todo: asyncio.Queue[str], counts: Counts) -> None:
    """One connection that takes the next read when it is free."""
    streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
    while True:
        path = await todo.get()
        began_s = time.perf_counter()
        try:
            if streams is None:
                streams = await asyncio.open_connection("127.0.0.1", port)
            status = await _answer(streams, path)
        except (OSError, asyncio.IncompleteReadError, ValueError):
            streams, status = None, 0
        counts.requests += 1
        if status >= 500 or status in (0, 429):
            counts.failures[f"{status} {path}"] += 1
        counts.latency_ms.append((time.perf_counter() - began_s) * 1e3)


async def _answer(streams: tuple[asyncio.StreamReader, asyncio.StreamWriter], path: str) -> int:
    reader, writer = streams
    writer.write(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    head = await reader.readuntil(b"\r\n\r\n")
    status, *lines = head.split(b"\r\n")
    headers = {k.lower(): v.strip() for k, _, v in (line.partition(b":") for line in lines)}
    await reader.readexactly(int(headers.get(b"content-length", b"0")))
    return int(status.split()[1])


async def load(port: int) -> Counts:
    """Load the gateway until SIGTERM."""
    counts, ended = Counts(), asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, ended.set)
    todo: asyncio.Queue[str] = asyncio.Queue(CONNECTIONS)
    jobs = [asyncio.create_task(watch(port, counts, True)) for _ in range(DASHBOARDS)]
    jobs += [asyncio.create_task(watch(port, counts, False))]
    jobs += [asyncio.create_task(ask(port, todo, counts)) for _ in range(CONNECTIONS)]
    began_s = time.perf_counter()
    for sent, path in enumerate(itertools.cycle(READS), 1):
        if ended.is_set():
            break
        try:
            todo.put_nowait(path)
        except asyncio.QueueFull:
            counts.late += 1
        if (early_s := began_s + sent / REQUESTS_PER_S - time.perf_counter()) > 0:
            await asyncio.sleep(early_s)
        elif sent % 20 == 0:
            await asyncio.sleep(0)
    for job in jobs:
        job.cancel()
    return counts


def main() -> None:
    parser = argparse.ArgumentParser(prog="helios-load-clients", description=__doc__)
    parser.add_argument("port", type=int)
    began_s = time.perf_counter()
    counts = asyncio.run(load(parser.parse_args().port))
    took_s = time.perf_counter() - began_s
    print(json.dumps({
        "dashboards": DASHBOARDS, "events": counts.events, "requests": counts.requests,
        "requests_per_s": round(counts.requests / took_s, 1), "failed": counts.failures.total(),
        "failures": dict(counts.failures), "late": counts.late,
        "latency_ms": percentiles(counts.latency_ms, 50, 99, digits=2),
    }))  # fmt: skip


if __name__ == "__main__":
    main()
