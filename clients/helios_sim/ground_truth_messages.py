"""Conversion of simulator ground truth to protobuf messages."""

from __future__ import annotations

from collections.abc import Iterable

from helios_core import proto as pb
from helios_core.codec import transform_to_proto, vector_to_proto

from helios_sim.drive_trace import DriveTrace
from helios_sim.ground_truth import Segmentation, TrueObjectState
from helios_sim.home import Episode, Home
from helios_sim.ovmm_metrics import Progress


def segmentation_to_proto(truth: Segmentation) -> pb.TruthSegmentation:
    height, width = truth.ids.shape
    return pb.TruthSegmentation(
        stamp_ns=truth.stamp_ns,
        width=width,
        height=height,
        ids=truth.ids.astype("<u2").tobytes(),
        instances=[
            pb.TruthInstance(
                id=instance.id,
                name=instance.name,
                class_name=instance.class_name,
                graspable=instance.graspable,
                center_m=vector_to_proto(instance.center_m),
                on=instance.on,
                turn_rad=instance.turn_rad,
            )
            for instance in truth.instances
        ],
        T_world_cam=transform_to_proto(truth.T_world_cam),
    )


def episode_to_proto(home: Home, episode: Episode) -> pb.TruthEpisode:
    return pb.TruthEpisode(
        seed=home.seed,
        preset=home.preset.name,
        object_class=episode.object_class,
        start_receptacle_class=episode.start_receptacle_class,
        goal_receptacle_class=episode.goal_receptacle_class,
        instruction=episode.instruction,
    )


def metrics_to_proto(progress: Progress) -> pb.TruthMetrics:
    return pb.TruthMetrics(
        find_object=progress.find_object,
        pick=progress.pick,
        find_receptacle=progress.find_receptacle,
        place=progress.place,
        success=progress.success,
        collision=progress.collisions > 0,
        collisions=progress.collisions,
        steps=progress.steps,
        collided_with=progress.collided_with,
        path_m=progress.path_m,
    )


def objects_to_proto(states: Iterable[TrueObjectState]) -> pb.TruthObjects:
    return pb.TruthObjects(
        instances=[
            pb.TruthInstance(
                name=state.name,
                class_name=state.class_name,
                graspable=state.graspable,
                center_m=vector_to_proto(state.center_m),
                on=state.on,
            )
            for state in states
        ]
    )


def trace_to_proto(trace: DriveTrace, since_ns: int) -> pb.TruthTrace:
    steps = trace.since(since_ns)
    return pb.TruthTrace(
        begun=trace.begun,
        actions=trace.actions,
        after_s=steps[:, 0],
        x_m=steps[:, 1],
        y_m=steps[:, 2],
    )
