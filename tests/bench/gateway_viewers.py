"""Measures the gateway's CPU and memory per dashboard viewer, at 10, 50 and 200 viewers.

    python -m tests.bench.gateway_viewers [--viewers 10,50,200] [--seconds 10]

The gateway runs in its own process over fake services: the camera at 10 Hz, a new map and new
objects every 2 s, the pose at 10 Hz. Each viewer does what the page does: it holds one event
stream, asks for the camera twice a second, and asks for map, cells, frontiers and objects whenever
an event says that they changed, with the tags that it has. Viewers use plain sockets, so that they
cost little compared with the gateway. One more viewer never reads. On a busy machine the viewers
ask less often than they should: `asked_of_wanted` is the share of their rate that they reached, and
`cpu_ms_an_answer` (events count as answers) still holds there.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import threading
import time
from multiprocessing.connection import Connection

import psutil

from tests.gateway_process import Served, served

FLAGS = ("--requests-per-s", "100000", "--max-viewers", "512", "--max-requests", "1024",
         "--max-connections", "4096", "--tick-s", "0.5")  # fmt: skip
MAP_PATHS = ("/v1/map", "/v1/map/cells.png", "/v1/map/frontiers", "/v1/objects")
CAMERA_PERIOD_S, MAP_PERIOD_S = 0.5, 2.0


def host(pipe: Connection) -> None:
    """The gateway's process: runs until a message comes through the pipe."""
    with served(*FLAGS) as stack:
        ended = threading.Event()
        threading.Thread(target=live, args=(stack, ended), daemon=True).start()
        pipe.send(stack.port)
        pipe.recv()
        ended.set()


def live(stack: Served, ended: threading.Event) -> None:
    """Publish a robot that looks and moves."""
    backend, step = stack.backend, 0
    while not ended.wait(0.1):
        step += 1
        backend.pose = (3.0 + step % 10 / 100, 2.2, 2.5)
        backend.publish_robot()
        backend.publish_observation(backend.publish_frame())
        if step % round(10 * MAP_PERIOD_S) == 0:
            backend.change_map()
            backend.change_objects()


class Asker:
    """One persistent connection with one request at a time."""

    def __init__(self, port: int, counts: dict[str, int]) -> None:
        self._port, self._counts = port, counts
        self._tags: dict[str, bytes] = {}
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def begin(self, path: str) -> tuple[asyncio.StreamReader, dict[bytes, bytes], int]:
        """Send the request; reader, headers and status of the answer. The body is still unread."""
        if self._streams is None:
            self._streams = await asyncio.open_connection("127.0.0.1", self._port)
        reader, writer = self._streams
        tag = b"If-None-Match: " + self._tags[path] + b"\r\n" if path in self._tags else b""
        writer.write(b"GET " + path.encode() + b" HTTP/1.1\r\nHost: localhost\r\n" + tag + b"\r\n")
        status, *lines = (await reader.readuntil(b"\r\n\r\n")).split(b"\r\n")
        headers = {k.lower(): v.strip() for k, _, v in (line.partition(b":") for line in lines)}
        return reader, headers, int(status.split()[1])

    async def fetch(self, path: str) -> None:
        reader, headers, status = await self.begin(path)
        if status != 304:
            await reader.readexactly(int(headers[b"content-length"]))
        if b"etag" in headers:
            self._tags[path] = headers[b"etag"]
        self._counts["requests"] += 1
        self._counts["failed"] += status not in (200, 304)

    def close(self) -> None:
        if self._streams is not None:
            self._streams[1].close()


async def view(port: int, ended: asyncio.Event, counts: dict[str, int]) -> None:
    """One open page."""
    pictures, maps, stream = (Asker(port, counts) for _ in range(3))
    changed = asyncio.Event()

    async def camera() -> None:
        while not ended.is_set():
            await pictures.fetch("/v1/camera.jpg")
            await asyncio.sleep(CAMERA_PERIOD_S)

    async def load_maps() -> None:
        while True:
            await changed.wait()
            changed.clear()
            for path in MAP_PATHS:
                await maps.fetch(path)

    async def events() -> None:
        reader, _, _ = await stream.begin("/v1/events")
        async for line in reader:
            if line.startswith(b"event: "):
                counts["events"] += 1
                if line.strip() == b"event: map":
                    changed.set()

    watching = [asyncio.create_task(work()) for work in (events, load_maps)]
    try:
        await camera()
    finally:
        for work in watching:
            work.cancel()
        for outcome in await asyncio.gather(*watching, return_exceptions=True):
            counts["failed"] += isinstance(outcome, Exception)
        for asker in (pictures, maps, stream):
            asker.close()


async def watch(port: int, viewers: int, seconds: float) -> dict[str, int]:
    """Keep `viewers` pages open for `seconds`."""
    counts = {"requests": 0, "failed": 0, "events": 0}
    ended = asyncio.Event()
    _, deaf = await asyncio.open_connection("127.0.0.1", port)
    deaf.write(b"GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
    pages = [asyncio.create_task(view(port, ended, counts)) for _ in range(viewers)]
    await asyncio.sleep(seconds)
    ended.set()
    for outcome in await asyncio.gather(*pages, return_exceptions=True):
        counts["failed"] += isinstance(outcome, BaseException)
    deaf.close()
    return counts


def measure(viewers: int, seconds: float) -> dict[str, float]:
    """Run a new gateway with `viewers` viewers; CPU in percent of one core, memory in MB."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=host, args=(there,))
    process.start()
    try:
        port = here.recv()
        gateway = psutil.Process(process.pid)
        time.sleep(2.0)
        memory_before = gateway.memory_info().rss
        began, spent = time.monotonic(), sum(gateway.cpu_times()[:2])
        counts = (
            asyncio.run(watch(port, viewers, seconds)) if viewers else time.sleep(seconds) or {}
        )
        wall_s = time.monotonic() - began
        cpu_s = sum(gateway.cpu_times()[:2]) - spent
        memory = (gateway.memory_info().rss - memory_before) / 1e6
        return {
            "viewers": viewers,
            "cpu_percent": round(cpu_s / wall_s * 100, 1),
            "cpu_s": round(cpu_s, 2),
            "memory_mb": round(memory, 1),
            "wall_s": round(wall_s, 1),
            **counts,
        }
    finally:
        here.send("end")
        process.join(10)
        process.kill()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--viewers", default="10,50,200")
    parser.add_argument("--seconds", type=float, default=10.0)
    args = parser.parse_args()
    nobody = measure(0, args.seconds)
    print(json.dumps(nobody), flush=True)
    for viewers in map(int, args.viewers.split(",")):
        row = measure(viewers, args.seconds)
        own_s = row["cpu_s"] - nobody["cpu_percent"] / 100 * row["wall_s"]
        wanted = viewers * row["wall_s"] * (1 / CAMERA_PERIOD_S + len(MAP_PATHS) / MAP_PERIOD_S)
        print(json.dumps(row | {
            "asked_of_wanted": round(row["requests"] / wanted, 2),
            "cpu_percent_a_viewer": round(own_s / row["wall_s"] * 100 / viewers, 2),
            "cpu_ms_an_answer": round(own_s * 1000 / max(row["requests"] + row["events"], 1), 2),
            "memory_mb_a_viewer": round((row["memory_mb"] - nobody["memory_mb"]) / viewers, 2),
        }), flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
