"""What a viewer of the dashboard costs the gateway: CPU and memory at 10, 50 and 200 viewers.

    python -m tests.bench.gateway_viewers [--viewers 10,50,200] [--seconds 10]

The gateway runs in a process of its own over made-up services: the camera at 10 Hz, a new map and
new objects every 2 s, the pose at 10 Hz. Each viewer does what the page does: it holds one stream
of events, asks for the camera twice a second and for map, cells, frontiers and objects whenever an
event says that they changed, with the tags that it has. Beside them one viewer never reads. On a
machine that is busy otherwise the viewers ask less often than they would; `cpu_ms_an_answer`
(events count as answers) still holds there.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import threading
import time
from multiprocessing.connection import Connection

import httpx
import psutil
from helios_client.event_stream import EventParser

from tests.gateway_process import Served, served

FLAGS = ("--requests-per-s", "100000", "--max-viewers", "512", "--max-requests", "1024",
         "--max-connections", "4096", "--tick-s", "0.5")  # fmt: skip
MAP_PATHS = ("/v1/map", "/v1/map/cells.png", "/v1/map/frontiers")


def host(pipe: Connection) -> None:
    """The process of the gateway: lives until the pipe says so."""
    with served(*FLAGS) as house:
        ended = threading.Event()
        threading.Thread(target=live, args=(house, ended), daemon=True).start()
        pipe.send(house.port)
        pipe.recv()
        ended.set()


def live(house: Served, ended: threading.Event) -> None:
    """The robot looks and moves."""
    backend, step = house.backend, 0
    while not ended.wait(0.1):
        step += 1
        backend.pose = (3.0 + step % 10 / 100, 2.2, 2.5)
        backend.publish_robot()
        backend.publish_observation(backend.publish_frame())
        if step % 20 == 0:
            backend.change_map()
            backend.change_objects()


async def view(client: httpx.AsyncClient, ended: asyncio.Event, counts: dict[str, int]) -> None:
    """One open page."""
    tags: dict[str, str] = {}

    async def fetch(path: str) -> None:
        headers = {"if-none-match": tags[path]} if path in tags else {}
        response = await client.get(path, headers=headers)
        counts["requests"] += 1
        counts["failed"] += response.status_code not in (200, 304)
        tags[path] = response.headers.get("etag", "")

    async def camera() -> None:
        while not ended.is_set():
            await fetch("/v1/camera.jpg")
            await asyncio.sleep(0.5)

    async def events() -> None:
        parser = EventParser()
        async with client.stream("GET", "/v1/events") as response:
            async for line in response.aiter_lines():
                event = parser.feed(line)
                if event:
                    counts["events"] += 1
                if event and event.type == "map":
                    for path in (*MAP_PATHS, "/v1/objects"):
                        await fetch(path)

    watching = asyncio.create_task(events())
    try:
        await camera()
    finally:
        watching.cancel()
        await asyncio.gather(watching, return_exceptions=True)


async def watch(port: int, viewers: int, seconds: float) -> dict[str, int]:
    """So many pages for so long."""
    limits = httpx.Limits(max_connections=None, max_keepalive_connections=None)
    counts = {"requests": 0, "failed": 0, "events": 0}
    ended = asyncio.Event()
    _, deaf = await asyncio.open_connection("127.0.0.1", port)
    deaf.write(b"GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
    async with httpx.AsyncClient(
        base_url=f"http://127.0.0.1:{port}", limits=limits, timeout=30
    ) as client:
        pages = [asyncio.create_task(view(client, ended, counts)) for _ in range(viewers)]
        await asyncio.sleep(seconds)
        ended.set()
        for outcome in await asyncio.gather(*pages, return_exceptions=True):
            counts["failed"] += isinstance(outcome, BaseException)
    deaf.close()
    return counts


def measure(viewers: int, seconds: float) -> dict[str, float]:
    """A fresh gateway with so many viewers; CPU in percent of one core, memory in MB."""
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
        return {"viewers": viewers, "cpu_percent": round(cpu_s / wall_s * 100, 1),
                "cpu_s": round(cpu_s, 2), "memory_mb": round(memory, 1),
                "wall_s": round(wall_s, 1), **counts}  # fmt: skip
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
        print(json.dumps(row | {
            "cpu_percent_a_viewer": round(own_s / row["wall_s"] * 100 / viewers, 2),
            "cpu_ms_an_answer": round(own_s * 1000 / max(row["requests"] + row["events"], 1), 2),
            "memory_mb_a_viewer": round((row["memory_mb"] - nobody["memory_mb"]) / viewers, 2),
        }), flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
