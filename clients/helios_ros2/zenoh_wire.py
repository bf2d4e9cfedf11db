"""Names and bytes of `rmw_zenoh`, as its design page publishes them. Experimental. No I/O.

A topic is the key `<domain>/<topic>/<type>/<type hash>`. Each node, publisher and subscription has
a liveliness token below `@ros2_lv`. Each message carries its number, time and sender.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from helios_ros2.offered_qos import Qos

TOKENS = "@ros2_lv"
PUBLISHER, SUBSCRIPTION, NODE = "MP", "MS", "NN"
GID = 16  # bytes of a sender's id
ATTACHMENT = struct.Struct("<qqB16s")  # number, time in ns, length of the id, id
RELIABLE, BEST_EFFORT = "1", "2"  # of rmw's enumeration; the default, reliable, is left out
RETAINED = "1"  # durability transient local; the default, volatile, is left out


@dataclass(frozen=True)
class Endpoint:
    """One publisher or subscription of another node."""

    kind: str  # PUBLISHER or SUBSCRIPTION
    topic: str
    type: str  # package/msg/Name
    type_hash: str
    qos: Qos


def wire_type(name: str) -> str:
    """`std_msgs::msg::dds_::String_` of `std_msgs/msg/String`."""
    package, part, short = name.split("/")
    return f"{package}::{part}::dds_::{short}_"


def ros_type(name: str) -> str:
    """The reverse of `wire_type`."""
    package, part, _, short = name.split("::")
    return f"{package}/{part}/{short.removesuffix('_')}"


def data_key(domain: int, topic: str, kind: str, type_hash: str) -> str:
    """Key of the messages of a topic."""
    return f"{domain}/{topic.strip('/')}/{wire_type(kind)}/{type_hash}"


def node_token(domain: int, session: str, name: str) -> str:
    """Liveliness token of a node."""
    return f"{TOKENS}/{domain}/{session}/0/0/{NODE}/%/%/{name}"


def endpoint_token(domain: int, session: str, number: int, node: str, end: Endpoint) -> str:
    """Liveliness token of a publisher or subscription; number: of the entity in its session."""
    return (
        f"{TOKENS}/{domain}/{session}/0/{number}/{end.kind}/%/%/{node}/"
        f"{end.topic.replace('/', '%')}/{wire_type(end.type)}/{end.type_hash}/{_qos_text(end.qos)}"
    )


def endpoint_of(token: str) -> Endpoint | None:
    """The publisher or subscription of a token; None for any other token."""
    parts = token.split("/")
    if len(parts) != 13 or parts[0] != TOKENS or parts[5] not in (PUBLISHER, SUBSCRIPTION):
        return None
    try:
        kind = ros_type(parts[10])
    except ValueError:
        return None
    return Endpoint(parts[5], parts[9].replace("%", "/"), kind, parts[11], _qos_of(parts[12]))


def attachment(number: int, stamp_ns: int, gid: bytes) -> bytes:
    """Attachment of one message; gid: the sender's id, 16 bytes."""
    return ATTACHMENT.pack(number, stamp_ns, GID, gid)


def _qos_text(qos: Qos) -> str:
    reliability = "" if qos.reliable else BEST_EFFORT
    return f"{reliability}:{RETAINED if qos.retained else ''}:,10:,:,:,,"


def _qos_of(text: str) -> Qos:
    parts = (*text.split(":"), "", "")
    return Qos(parts[0] != BEST_EFFORT, parts[1] == RETAINED)
