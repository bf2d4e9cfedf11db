"""A client that drives a robot, in its own process, with generated messages and bare Zenoh.

python driver.py tcp/127.0.0.1:7447      prints its observations as JSON
"""

import json
import sys
import threading
import time

import zenoh
from helios.v1 import common_pb2, frame_pb2, robot_pb2  # pyright: ignore[reportMissingImports]

ROOT = "helios/v1/robot/"
WITHIN_S = 60.0


class Refused(Exception):
    """The call returned a typed error."""


def call(session, method, request, reply_type, timeout_s=30.0):
    """Call a method and join the pieces of its reply in order."""
    parts, count = {}, 0
    for reply in session.get(
        f"{ROOT}svc/{method}",
        payload=request.SerializeToString(),
        timeout=timeout_s,
        consolidation=zenoh.ConsolidationMode.NONE,
    ):
        if reply.err is not None:
            error = common_pb2.Error.FromString(reply.err.payload.to_bytes())
            raise Refused(common_pb2.ErrorKind.Name(error.kind), error.message)
        head = reply.ok.attachment.to_string() if reply.ok.attachment is not None else "0/1/-"
        index, count, _ = head.split("/")
        parts[int(index)] = reply.ok.payload.to_bytes()
    if not parts or len(parts) != int(count):
        raise TimeoutError(f"{method} gave {len(parts)} of {count} pieces")
    return reply_type.FromString(b"".join(parts[i] for i in sorted(parts)))


class Heard:
    """Received keyframes and acknowledgements of the occupancy map, by keyframe number."""

    def __init__(self, session):
        self.keyframes, self.acks, self.news = {}, {}, threading.Condition()
        self.subscribers = [
            session.declare_subscriber(f"{ROOT}bridge/keyframe", self._on_keyframe),
            session.declare_subscriber(f"{ROOT}map2d/ack", self._on_ack),
        ]

    def _on_keyframe(self, sample):
        frame = frame_pb2.Frame.FromString(sample.payload.to_bytes())
        with self.news:
            self.keyframes[frame.id.seq] = frame
            self.news.notify_all()

    def _on_ack(self, sample):
        ack = frame_pb2.Ack.FromString(sample.payload.to_bytes())
        with self.news:
            self.acks[ack.id.seq, ack.part] = ack
            self.news.notify_all()

    def wait_for(self, seq, timeout_s):
        """Whether the keyframe and its acknowledgement arrive within `timeout_s`."""
        with self.news:
            return self.news.wait_for(
                lambda: seq in self.keyframes and (seq, "occupancy") in self.acks, timeout_s
            )

    def close(self):
        for subscriber in self.subscribers:
            subscriber.undeclare()


class Driver:
    """Acts under a lease."""

    def __init__(self, session):
        self.session = session
        lease = robot_pb2.LeaseRequest(holder="bare driver")
        self.token = call(session, "bridge/lease", lease, robot_pb2.LeaseReply).token

    def act(self, id, token=None, **kind):
        action = robot_pb2.Action(**kind)
        request = robot_pb2.ActionRequest(
            action_id=id, lease_token=token or self.token, time_remaining_s=20.0, action=action
        )
        return call(self.session, "bridge/act", request, robot_pb2.ActionResult)

    def look_until(self, heard):
        """Look until a keyframe arrives: the router needs a moment to learn the subscriptions."""
        deadline_s, k = time.monotonic() + WITHIN_S, 0
        while time.monotonic() < deadline_s:
            k += 1
            look = self.act(f"look {k}", observe=robot_pb2.Action.Observe())
            if heard.wait_for(look.keyframe.seq, 0.5):
                return
        raise TimeoutError("no keyframe was heard")

    def refusal(self):
        """The kind of error that answers an action without a lease."""
        try:
            self.act("without a lease", self.token + 1, observe=robot_pb2.Action.Observe())
        except Refused as error:
            return error.args[0]
        return ""


def main():
    config = {
        "mode": "client",
        "connect": {"endpoints": [sys.argv[1]]},
        "scouting": {"multicast": {"enabled": False}},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        heard, driver = Heard(session), Driver(session)
        driver.look_until(heard)
        drive = driver.act("drive", forward=robot_pb2.Action.Forward(distance_m=0.5))
        again = driver.act("drive", forward=robot_pb2.Action.Forward(distance_m=0.5))
        turn = driver.act("turn", turn=robot_pb2.Action.Turn(angle_rad=0.4))
        seq = turn.keyframe.seq
        was_heard = heard.wait_for(seq, WITHIN_S)
        refused = driver.refusal()
        state = call(session, "bridge/get_state", common_pb2.Empty(), robot_pb2.RobotState)
        heard.close()
    frame = heard.keyframes.get(seq)
    said = {
        "drive": {"succeeded": drive.succeeded, "moved_m": drive.moved_m},
        "done_once": drive == again,
        "turned_rad": turn.turned_rad,
        "x_m": state.T_world_base.rows[3],
        "heard": was_heard,
        "accepted": heard.acks[seq, "occupancy"].accepted if was_heard else False,
        "image": [frame.raw_color.width, frame.raw_color.height] if frame else [],
        "refused": refused,
        "imports_of_helios": [name for name in sys.modules if name.startswith("helios_")],
    }
    print(json.dumps(said))


if __name__ == "__main__":
    main()
