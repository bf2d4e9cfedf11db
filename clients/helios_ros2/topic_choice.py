"""Choice of the camera's topics among those that the robot publishes. No I/O."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from helios_core.errors import Unavailable

BATTERY = "sensor_msgs/msg/BatteryState"
RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_NOT_A_CAMERA = ("mask", "debug", "overlay", "annotated", "/helios/", "infra", "confidence")
_COLOR, _DEPTH = ("color", "rgb", "image"), ("aligned_depth", "depth_registered", "depth")
_ENDINGS = ("image_rect_color", "image_raw", "image_rect", "image")  # best first


def color_topic(graph: Mapping[str, Sequence[str]], given: str) -> str:
    """Topic of the colour image. graph: topic -> types. Raises Unavailable without a clear one."""
    return given or _one("color", graph, _COLOR, ("depth", "disparity"))


def depth_topic(graph: Mapping[str, Sequence[str]], given: str) -> str:
    """Topic of the depth image, one registered to colour if there is. Raises Unavailable."""
    return given or _one("depth", graph, _DEPTH, ())


def battery_topic(graph: Mapping[str, Sequence[str]], given: str) -> str:
    """Topic of the battery: the given one, or the only one. Raises Unavailable without a clear
    one."""
    found = [given] if given else sorted(t for t, types in graph.items() if BATTERY in types)
    if len(found) != 1:
        raise Unavailable(
            f"{len(found)} topics of {BATTERY} are published; name one with HELIOS_ROS2_BATTERY"
        )
    return found[0]


def info_beside(image_topic: str) -> str:
    """Usual topic of the CameraInfo of an image: `camera_info` in the same namespace."""
    parts = image_topic.split("/")
    if parts[-1] in ("compressed", "compressedDepth"):
        parts = parts[:-1]
    return "/".join([*parts[:-1], "camera_info"])


def _one(
    what: str, graph: Mapping[str, Sequence[str]], hints: Sequence[str], not_hints: Sequence[str]
) -> str:
    images = sorted(topic for topic, types in graph.items() if RAW in types)
    left = [t for t in images if not any(n in t for n in (*not_hints, *_NOT_A_CAMERA))]
    by_hint = ([t for t in left if hint in t] for hint in hints)
    found = next((f for f in by_hint if f), [])
    by_ending = ([t for t in found if t.endswith("/" + e)] for e in _ENDINGS)
    found = next((f for f in by_ending if f), found)
    if len(found) == 1:
        return found[0]
    if found:
        raise Unavailable(
            f"several topics may be the {what} image: {', '.join(found)}; name one with "
            f"HELIOS_ROS2_{what.upper()}"
        )
    listed = f"the images are {', '.join(images)}" if images else "nobody publishes an image"
    raise Unavailable(
        f"no topic of {RAW} looks like the {what} image ({listed}); name it with "
        f"HELIOS_ROS2_{what.upper()}, and see that ROS_DOMAIN_ID is the robot's"
    )
