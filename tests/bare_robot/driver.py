"""Somebody who drives a robot, in a process of its own, with generated messages and bare Zenoh.

python driver.py tcp/127.0.0.1:7447      prints what it saw as JSON
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
    """A typed error came back."""


def call(session, method, request, reply_type, timeout_s=30.0):
    """One call; its pieces put together in their order."""
    parts, count = {}, 0
    for reply in session.get(
        f"{ROOT}svc/{method}", payload=request.SerializeToString(), timeout=timeout_s,
        consolidation=zenoh.ConsolidationMode.NONE,
    ):  # fmt: skip
        if reply.err is not None:
            error = common_pb2.Error.FromString(reply.err.payload.to_bytes())
            raise Refused(common_pb2.ErrorKind.Name(error.kind), error.message)
        head = reply.ok.attachment.to_string() if reply.ok.attachment is not None else "0/1/-"
        index, count, _ = head.split("/")
        parts[int(index)] = reply.ok.payload.to_bytes()
    if not parts or len(parts) != int(count):
        raise TimeoutError(f"{method} gave {len(parts)} of {count} pieces")
    return reply_type.FromString(b"".join(parts[i] for i in sorted(parts)))


def main():
    config = {
        "mode": "client",
        "connect": {"endpoints": [sys.argv[1]]},
        "scouting": {"multicast": {"enabled": False}},
    }
    keyframes, acks, news = {}, {}, threading.Condition()

    def on_keyframe(sample):
        frame = frame_pb2.Frame.FromString(sample.payload.to_bytes())
        with news:
            keyframes[frame.id.seq] = frame
            news.notify_all()

    def on_ack(sample):
        ack = frame_pb2.Ack.FromString(sample.payload.to_bytes())
        with news:
            acks[ack.id.seq, ack.part] = ack
            news.notify_all()

    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        subscribers = [
            session.declare_subscriber(f"{ROOT}bridge/keyframe", on_keyframe),
            session.declare_subscriber(f"{ROOT}map2d/ack", on_ack),
        ]
        lease = robot_pb2.LeaseRequest(holder="bare driver")
        token = call(session, "bridge/lease", lease, robot_pb2.LeaseReply).token

        def act(id, token=token, **kind):
            action = robot_pb2.Action(**kind)
            request = robot_pb2.ActionRequest(
                action_id=id, lease_token=token, time_remaining_s=20.0, action=action
            )
            return call(session, "bridge/act", request, robot_pb2.ActionResult)

        def seen(seq):
            return seq in keyframes and (seq, "occupancy") in acks

        deadline_s, k = time.monotonic() + WITHIN_S, 0
        while True:  # the subscriptions take a moment to be known
            k += 1
            look = act(f"look {k}", observe=robot_pb2.Action.Observe())
            with news:
                if news.wait_for(lambda: seen(look.keyframe.seq), 0.5):  # noqa: B023
                    break
            if time.monotonic() > deadline_s:
                raise TimeoutError("no keyframe was heard")
        drive = act("drive", forward=robot_pb2.Action.Forward(distance_m=0.5))
        again = act("drive", forward=robot_pb2.Action.Forward(distance_m=0.5))
        turn = act("turn", turn=robot_pb2.Action.Turn(angle_rad=0.4))
        with news:
            heard = news.wait_for(lambda: seen(turn.keyframe.seq), WITHIN_S)
        try:
            act("without a lease", token=token + 1, observe=robot_pb2.Action.Observe())
            refused = ""
        except Refused as error:
            refused = error.args[0]
        frame = keyframes.get(turn.keyframe.seq)
        state = call(session, "bridge/get_state", common_pb2.Empty(), robot_pb2.RobotState)
        for subscriber in subscribers:
            subscriber.undeclare()
    said = {
        "drive": {"succeeded": drive.succeeded, "moved_m": drive.moved_m},
        "done_once": drive == again,
        "turned_rad": turn.turned_rad,
        "x_m": state.T_world_base.rows[3],
        "heard": heard,
        "accepted": acks[turn.keyframe.seq, "occupancy"].accepted if heard else False,
        "image": [frame.raw_color.width, frame.raw_color.height] if frame else [],
        "refused": refused,
        "imports_of_helios": [name for name in sys.modules if name.startswith("helios_")],
    }
    print(json.dumps(said))


if __name__ == "__main__":
    main()
