"""A robot in its own process: generated messages, a bare Zenoh session, the standard library.

It stands for a robot in another language, so it imports nothing of HELIOS. It was written from
`docs/reference/wire-contract.md` and the `.proto` files alone. Its world is an empty square room.

    python robot.py tcp/127.0.0.1:7447      (the generated messages on PYTHONPATH)
"""

import json
import math
import sys
import threading
import time
import traceback
import uuid

import zenoh
from helios.v1 import common_pb2, robot_pb2  # pyright: ignore[reportMissingImports]

ROOT = "helios/v1/robot/svc/world/"
ERROR = "application/protobuf;helios.v1.Error"
WIDTH, HEIGHT, FOCAL = 80, 60, 70.0
CAMERA_M, RADIUS_M, WALL_M, CEILING_M = 1.1, 0.2, 2.0, 2.5  # the room reaches from -2 m to 2 m
STEP_M, STEP_RAD, STEP_S = 0.02, 0.04, 0.01


class Robot:
    """A point robot with a camera that is tilted down slightly."""

    def __init__(self):
        self.x_m, self.y_m, self.yaw_rad, self.tilt_rad = 0.0, 0.0, 0.0, 0.3
        self.stopped, self.why, self.results = threading.Event(), "", {}
        self.boot_id = uuid.uuid4().hex
        self.turn = threading.Lock()

    def describe(self, _):
        return robot_pb2.RobotDescription(
            name="bare robot", footprint_radius_m=RADIUS_M, height_m=1.2, camera=pinhole(),
            camera_height_m=CAMERA_M, min_forward_m=0.1, max_forward_m=1.0, min_turn_rad=0.1,
            max_turn_rad=0.6, min_tilt_rad=-0.2, max_tilt_rad=0.8, can_move=True, max_depth_m=5.0,
        )  # fmt: skip

    def state(self, _):
        return robot_pb2.RobotState(
            T_world_base=transform(self.base_rows()),
            tilt_rad=self.tilt_rad,
            stopped=self.stopped.is_set(),
            robot_boot_id=self.boot_id,
            message=self.why,
        )

    def capture(self, _):
        rows = self.camera_rows()
        color, depth_mm = bytearray(), bytearray()
        for v in range(HEIGHT):
            for u in range(WIDTH):
                ray = ((u - (WIDTH - 1) / 2) / FOCAL, (v - (HEIGHT - 1) / 2) / FOCAL, 1.0)
                paint, depth_m = cast(rows, ray)
                color += bytes(paint)
                depth_mm += round(depth_m * 1000).to_bytes(2, "little")
        return robot_pb2.WorldCapture(
            color=bytes(color),
            depth_mm=bytes(depth_mm),
            camera=pinhole(),
            T_world_cam=transform(rows),
            T_world_base=transform(self.base_rows()),
            stamp_ns=time.time_ns(),
        )

    def act(self, request):
        with self.turn:
            if request.action_id not in self.results:  # each id runs once
                self.results[request.action_id] = self.do(request.action, request.action_id)
            return self.results[request.action_id]

    def stop(self, request):
        self.why = f"stopped: {request.reason}"
        self.stopped.set()
        return common_pb2.Empty()

    def clear_stop(self, _):
        self.why = ""
        self.stopped.clear()
        return common_pb2.Empty()

    def do(self, action, action_id):
        x_m, y_m, yaw_rad = self.x_m, self.y_m, self.yaw_rad
        kind = action.WhichOneof("kind")
        if self.stopped.is_set():
            why_not = f"{self.why}; clear the stop first"
        elif kind == "forward" and action.forward.distance_m < 0:
            why_not = "this robot does not drive back; turn, and drive ahead"
        elif kind == "forward":
            why_not = self.move(action.forward.distance_m, 0.0)
        elif kind == "turn":
            why_not = self.move(0.0, action.turn.angle_rad)
        elif kind == "tilt":
            self.tilt_rad, why_not = action.tilt.angle_rad, ""
        else:
            why_not = "" if kind == "observe" else "this robot has no hand"
        return robot_pb2.ActionResult(
            action_id=action_id,
            succeeded=not why_not,
            reason=why_not,
            moved_m=math.hypot(self.x_m - x_m, self.y_m - y_m),
            turned_rad=math.remainder(self.yaw_rad - yaw_rad, 2 * math.pi),
            steps=len(self.results) + 1,
        )

    def move(self, ahead_m, left_rad):
        steps = math.ceil(max(abs(ahead_m) / STEP_M, abs(left_rad) / STEP_RAD, 1))
        for _ in range(steps):
            if self.stopped.wait(STEP_S):
                return self.why
            self.yaw_rad += left_rad / steps
            x_m = self.x_m + ahead_m / steps * math.cos(self.yaw_rad)
            y_m = self.y_m + ahead_m / steps * math.sin(self.yaw_rad)
            if max(abs(x_m), abs(y_m)) > WALL_M - RADIUS_M:
                return "blocked by a wall"
            self.x_m, self.y_m = x_m, y_m
        return ""

    def base_rows(self):
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return [[c, -s, 0, self.x_m], [s, c, 0, self.y_m], [0, 0, 1, 0], [0, 0, 0, 1]]

    def camera_rows(self):
        """Columns: the camera's right, down and forward axes in the world, then its position."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        ct, st = math.cos(self.tilt_rad), math.sin(self.tilt_rad)
        right, down, ahead = (s, -c, 0), (-st * c, -st * s, -ct), (ct * c, ct * s, -st)
        at = (self.x_m, self.y_m, CAMERA_M)
        return [*([*row] for row in zip(right, down, ahead, at, strict=True)), [0, 0, 0, 1]]


def pinhole():
    return common_pb2.Pinhole(
        fx=FOCAL, fy=FOCAL, cx=(WIDTH - 1) / 2, cy=(HEIGHT - 1) / 2, width=WIDTH, height=HEIGHT
    )


def transform(rows):
    return common_pb2.Transform(rows=[float(value) for row in rows for value in row])


def cast(rows, ray):
    """Colour and depth where a camera ray hits; the ray's length along the optical axis is 1."""
    best = (math.inf, (0, 0, 0))
    for axis, (low, high) in enumerate(((-WALL_M, WALL_M), (-WALL_M, WALL_M), (0.0, CEILING_M))):
        ahead = sum(rows[axis][k] * ray[k] for k in range(3))
        if ahead:
            depth_m = ((high if ahead > 0 else low) - rows[axis][3]) / ahead
            paint = [90 + 60 * axis, 120, 200 if ahead > 0 else 60]
            best = min(best, (depth_m, tuple(paint)))
    return best[1], best[0]


def serve(session, name, request_type, handler):
    def answer(query):
        with query:
            try:
                data = query.payload.to_bytes() if query.payload is not None else b""
                reply = handler(request_type.FromString(data)).SerializeToString()
                query.reply(ROOT + name, reply)  # one piece needs no attachment
            except Exception as error:
                traceback.print_exc()
                wrong = common_pb2.Error(kind=common_pb2.ERROR_KIND_INTERNAL, message=str(error))
                query.reply_err(wrong.SerializeToString(), encoding=ERROR)

    def accept(query):  # a thread for each query: a stop arrives while an action runs
        threading.Thread(target=answer, args=(query,), daemon=True).start()

    return session.declare_queryable(ROOT + name, accept)


def main():
    config = {
        "mode": "client",
        "connect": {"endpoints": [sys.argv[1]]},
        "scouting": {"multicast": {"enabled": False}},
    }
    robot = Robot()
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        kept = [
            serve(session, "state", common_pb2.Empty, robot.state),
            serve(session, "capture", common_pb2.Empty, robot.capture),
            serve(session, "act", robot_pb2.WorldActRequest, robot.act),
            serve(session, "stop", robot_pb2.StopRequest, robot.stop),
            serve(session, "clear_stop", common_pb2.Empty, robot.clear_stop),
            # Last, since clients wait for it.
            serve(session, "describe", common_pb2.Empty, robot.describe),
        ]
        foreign = [name for name in sys.modules if name.startswith("helios_")]
        print(json.dumps({"serves": len(kept), "imports_of_helios": foreign}), flush=True)
        sys.stdin.read()  # until the parent process closes the pipe


if __name__ == "__main__":
    main()
