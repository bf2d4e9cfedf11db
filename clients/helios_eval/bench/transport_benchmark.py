"""Benchmark that sends a raw 640x480 RGB-D frame to another process and awaits its reply."""

from __future__ import annotations

import subprocess
import sys
import threading
import time

import zmq
from helios_client.supervision.service_specs import free_port
from helios_core import proto as pb
from helios_core.bus import Bus
from helios_core.codec import frame_message, frame_to_proto
from helios_core.errors import Unavailable
from helios_core.topics import KEYFRAME, OBJECTMAP_ACK
from helios_core.zenoh_bus import ZenohBus

from helios_eval.bench.synthetic_flat import frames
from helios_eval.bench.timing import Row, compare

ZMQ_ECHO = """
import sys, zmq
s = zmq.Context().socket(zmq.REP); s.bind(sys.argv[1])
while len(s.recv()): s.send(b"ok")
"""
ZENOH_ECHO = """
import sys
from helios_core import proto as pb
from helios_core.codec.images import color_array
from helios_core.image_messages import image_data
from helios_core.topics import KEYFRAME, OBJECTMAP_ACK
from helios_core.zenoh_bus import ZenohBus
bus = ZenohBus(sys.argv[1])
def answer(frame):
    color = color_array(frame.raw_color, None, image_data(frame, "raw_color"))
    bus.publish(OBJECTMAP_ACK, pb.Ack(version=int(color[-1, -1, 0])))
bus.subscribe_in_place(KEYFRAME, answer)
sys.stdin.read()
bus.close()
"""


def frame_transport() -> Row:
    router, address = f"tcp/127.0.0.1:{free_port()}", f"tcp://127.0.0.1:{free_port()}"
    processes = [
        subprocess.Popen([sys.executable, "-m", "helios_core.router", "--listen", router]),
        subprocess.Popen([sys.executable, "-c", ZMQ_ECHO, address]),
    ]
    bus: Bus | None = None
    try:
        bus = _open(router)
        processes.append(
            subprocess.Popen([sys.executable, "-c", ZENOH_ECHO, router], stdin=subprocess.PIPE)
        )
        message, ours_message = frame_to_proto(frames()[0]), frame_message(frames()[0])
        answered = threading.Event()
        bus.subscribe(OBJECTMAP_ACK, lambda _: answered.set())

        def ours(_: int) -> None:
            answered.clear()
            while True:
                bus.publish(KEYFRAME, ours_message)
                if answered.wait(2):
                    return

        peer = zmq.Context().socket(zmq.REQ)
        peer.connect(address)

        def theirs(_: int) -> pb.Frame:
            sent = message.SerializeToString()
            peer.send(sent)
            peer.recv()
            return pb.Frame.FromString(sent)  # what the other process has to do, too

        size = f"{message.ByteSize() / 1e6:.2f} MB frame and an answer, two processes"
        return compare("frame_transport", size, ours, "pyzmq over TCP", theirs, 60)
    finally:
        if bus is not None:
            bus.close()
        for process in processes:
            process.kill()
            process.wait()


def _open(router: str) -> ZenohBus:
    deadline = time.monotonic() + 60
    while True:
        try:
            return ZenohBus(router)
        except Unavailable:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)
