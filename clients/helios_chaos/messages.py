"""Sends damaged, old and double messages on the bus, as a faulty client could."""

from __future__ import annotations

import random
import threading
import time
from collections import deque

import zenoh
from helios_core.topics import ROOT
from helios_core.zenoh_config import client_config, open_session

from helios_chaos.schedule import MESSAGES

KEPT = 20  # newest messages of each topic
BURST = 5  # damaged messages at a time


class MessageTap:
    """Listens to topics on a bare Zenoh session, and sends their messages again."""

    def __init__(self, router: str, seed: int, robot: str = "robot") -> None:
        self._random = random.Random(seed)
        self._robot = robot
        self._heard = {topic: deque[bytes](maxlen=KEPT) for topic in MESSAGES}
        self._lock = threading.Lock()
        self._session = open_session(client_config(router))[0]
        self._readers = [self._listen(topic) for topic in MESSAGES]

    def has_heard(self, topic: str) -> bool:
        """True if there is a message of the topic to send again."""
        with self._lock:
            return bool(self._heard[topic])

    def damaged(self, topic: str) -> None:
        """Send messages that are cut short, with wrong bits or of noise."""
        for _ in range(BURST):
            self._put(topic, damaged(self._one(topic, newest=True), self._random))

    def old(self, topic: str) -> None:
        """Send the oldest message that is kept."""
        self._put(topic, self._one(topic, newest=False))

    def double(self, topic: str) -> None:
        """Send the newest message twice more."""
        for _ in range(2):
            self._put(topic, self._one(topic, newest=True))

    def close(self) -> None:
        self._session.close()
        for reader in self._readers:
            reader.join(1.0)

    def _one(self, topic: str, newest: bool) -> bytes:
        with self._lock:
            return self._heard[topic][-1 if newest else 0]

    def _put(self, topic: str, data: bytes) -> None:
        self._session.put(f"{ROOT}/{self._robot}/{topic}", data)

    def _listen(self, topic: str) -> threading.Thread:
        key = f"{ROOT}/{self._robot}/{topic}"
        subscriber = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(1))

        def read() -> None:
            while True:
                try:
                    data = subscriber.handler.recv().payload.to_bytes()
                except zenoh.ZError:  # the session is closed
                    return
                with self._lock:
                    self._heard[topic].append(data)

        reader = threading.Thread(target=read, name=f"tap {topic}", daemon=True)
        reader.start()
        return reader


def damaged(data: bytes, random_: random.Random) -> bytes:
    """Message cut short, with wrong bits, or replaced by noise."""
    way = random_.randrange(3)
    if way == 0 or not data:
        return random_.randbytes(random_.randrange(1, 2000))
    if way == 1:
        return data[: random_.randrange(len(data))]
    wrong = bytearray(data)
    for _ in range(random_.randrange(1, 30)):
        # A message begins with its header; most wrong bits elsewhere would only colour pixels.
        place = random_.randrange(min(len(wrong), 400))
        wrong[place] ^= 1 << random_.randrange(8)
    return bytes(wrong)


def opened(router: str, seed: int, within_s: float = 60.0) -> MessageTap:
    """Tap at a router that may be starting."""
    deadline_s = time.monotonic() + within_s
    while True:
        try:
            return MessageTap(router, seed)
        except zenoh.ZError:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(0.1)
