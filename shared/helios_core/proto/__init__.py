"""Messages of `helios.v1`, the wire contract. Use: `from helios_core import proto as pb`."""

from helios_core.proto.helios.v1.common_pb2 import *
from helios_core.proto.helios.v1.frame_pb2 import *
from helios_core.proto.helios.v1.map_pb2 import *
from helios_core.proto.helios.v1.robot_pb2 import *
from helios_core.proto.helios.v1.search_pb2 import *
from helios_core.proto.helios.v1.task_pb2 import *
from helios_core.proto.helios.v1.trace_pb2 import *
