"""The fake Spot's server: every service on one port behind TLS, as on the real robot."""

from __future__ import annotations

from concurrent import futures
from pathlib import Path
from typing import Any

import grpc
import trustme

from tests.fake_spot import pb
from tests.fake_spot.access import TOKEN, Auth, Directory, RobotId, TimeSync
from tests.fake_spot.action import Commands, Manipulation
from tests.fake_spot.cameras import Source, sources
from tests.fake_spot.right import Estop, Leases, Power
from tests.fake_spot.rooms import tea_room
from tests.fake_spot.senses import Images, State
from tests.fake_spot.wire import Wire
from tests.fake_spot.world import World

USER, PASSWORD = "user", "a password"
_OPEN = ("AuthService", "RobotIdService")


class _NeedsToken(grpc.ServerInterceptor):
    """Refuses calls without the login token, except to login and identity."""

    def intercept_service(self, continuation: Any, handler_call_details: Any) -> Any:
        given = ("authorization", f"Bearer {TOKEN}") in [
            tuple(m) for m in handler_call_details.invocation_metadata
        ]
        if given or any(name in handler_call_details.method for name in _OPEN):
            return continuation(handler_call_details)

        def refuse(_: Any, context: Any) -> None:
            context.abort(grpc.StatusCode.UNAUTHENTICATED, "no token")

        return grpc.unary_unary_rpc_method_handler(refuse)


class FakeSpot:
    """Runs until `close`. `folder` gets the certificate that clients must trust."""

    def __init__(
        self,
        folder: Path,
        world: World | None = None,
        cameras: dict[str, Source] | None = None,
        without: frozenset[str] = frozenset(),
        port: int = 0,
    ) -> None:
        """without: services that this robot does not have."""
        self.world = world or World(*tea_room())
        self.ca_file = folder / "fake-spot-ca.pem"
        authority = trustme.CA()
        # The SDK connects to auth.spot.robot etc.
        certificate = authority.issue_cert("*.spot.robot")
        authority.cert_pem.write_to_path(self.ca_file)
        self._server = grpc.server(
            futures.ThreadPoolExecutor(16, "fake-spot"),
            options=pb.channel.generate_channel_options(),
            interceptors=[_NeedsToken()],
        )
        self.leases = Leases(self.world)
        self.images = Images(self.world, dict(sources() if cameras is None else cameras))
        self.estop = Estop(self.world)
        self.clock = TimeSync(self.world)
        self.commands = Commands(self.world, self.leases)
        services = {
            "AuthService": Auth(self.world, USER, PASSWORD),
            "DirectoryService": Directory(self.world, without),
            "RobotIdService": RobotId(self.world),
            "TimeSyncService": self.clock,
            "LeaseService": self.leases,
            "EstopService": self.estop,
            "PowerService": Power(self.world, self.leases),
            "RobotStateService": State(self.world),
            "ImageService": self.images,
            "RobotCommandService": self.commands,
            "ManipulationApiService": Manipulation(self.world, self.leases),
        }
        for name, service in services.items():
            getattr(pb.SERVICERS[name], f"add_{name}Servicer_to_server")(service, self._server)
        chain = b"".join(part.bytes() for part in certificate.cert_chain_pems)
        secret = certificate.private_key_pem.bytes()
        credentials = grpc.ssl_server_credentials([(secret, chain)])
        self.server_port = self._server.add_secure_port(f"127.0.0.1:{port}", credentials)
        self._server.start()
        self.wire = Wire(self.server_port)

    @property
    def port(self) -> int:
        """The port of the connection that a test can cut."""
        return self.wire.port

    @property
    def environment(self) -> dict[str, str]:
        """The settings with which the driver connects to this robot."""
        return {
            "HELIOS_SPOT_HOST": "127.0.0.1",
            "HELIOS_SPOT_PORT": str(self.port),
            "HELIOS_SPOT_CA_FILE": str(self.ca_file),
            "HELIOS_SPOT_USERNAME": USER,
            "HELIOS_SPOT_PASSWORD": PASSWORD,
        }

    def close(self) -> None:
        self._server.stop(0).wait(5)
        self.wire.close()
