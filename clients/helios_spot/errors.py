"""Translation of the SDK's errors to HELIOS errors, with the cause and the remedy."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from helios_core.errors import (
    Conflict,
    DeadlineExceeded,
    HeliosError,
    Internal,
    InvalidInput,
    Unavailable,
)

from helios_spot import bosdyn_api

_SDK_ERRORS: tuple[type[Exception], ...] = (bosdyn_api.exceptions.Error, bosdyn_api.lease.Error)

# The first match applies. {host}: the robot; {owner}: holder of its lease; {error}: the SDK's text.
_SENTENCES: tuple[tuple[Any, type[HeliosError], str], ...] = (
    (bosdyn_api.auth.InvalidLoginError, InvalidInput,
     "the robot refuses this name and password; mend HELIOS_SPOT_USERNAME and "
     "HELIOS_SPOT_PASSWORD (or the credentials file), then start again"),
    (bosdyn_api.auth.TemporarilyLockedOutError, InvalidInput,
     "the robot has locked this user out after too many wrong passwords; wait some minutes, mend "
     "the login, then start again"),
    ((bosdyn_api.exceptions.UnauthenticatedError, bosdyn_api.auth.InvalidTokenError), Unavailable,
     "the robot does not accept our login any more; restart the bridge to log in anew"),
    (bosdyn_api.lease.ResourceAlreadyClaimedError, Conflict,
     "{owner} holds the robot's lease; have it released there (tablet: power menu, release "
     "control), or set HELIOS_SPOT_LEASE=take"),
    ((bosdyn_api.exceptions.LeaseUseError, bosdyn_api.lease.NoSuchLease,
      bosdyn_api.lease.LeaseNotOwnedByWallet,
      bosdyn_api.lease.LeaseResponseError), Conflict,
     "{owner} has taken the robot's lease; it obeys them alone until they release it"),
    (bosdyn_api.power.EstoppedError, Conflict,
     "an e-stop is pressed; release it on the tablet, or set HELIOS_SPOT_ESTOP=endpoint"),
    (bosdyn_api.estop.MotorsOnError, Conflict,
     "the motors are on, and an e-stop is set up only while they are off; sit the robot down and "
     "switch its motors off on the tablet"),
    (bosdyn_api.power.KeepaliveMotorsOffError, Conflict,
     "a keep-alive policy of the robot keeps its motors off; end it on the tablet"),
    (bosdyn_api.power.ShorePowerConnectedError, Conflict,
     "the robot hangs on its charging cable; unplug it"),
    (bosdyn_api.power.BatteryMissingError, Conflict, "the robot has no battery; put one in"),
    (bosdyn_api.power.FaultedError, Conflict,
     "a fault keeps the motors off; read and clear it on the tablet"),
    ((bosdyn_api.power.PowerError, bosdyn_api.power.PowerResponseError,
      bosdyn_api.exceptions.LicenseError), Conflict,
     "the motors did not come on ({error}); look at the robot's power menu on the tablet"),
    (bosdyn_api.robot_command.NotPoweredOnError, Conflict,
     "the motors are off; switch them on at the tablet, or set HELIOS_SPOT_POWER=on"),
    (bosdyn_api.robot_command.ExpiredError, DeadlineExceeded,
     "the robot got the command after its end: the network is too slow, or a clock has jumped; "
     "the clocks are compared anew, send the action again"),
    ((bosdyn_api.robot_command.NoTimeSyncError, bosdyn_api.robot_command.TooDistantError,
      bosdyn_api.time_sync.TimeSyncError), Unavailable,
     "the robot's clock and ours cannot be brought together; see whether its time-sync service "
     "runs (tablet: about, services), then try again"),
    (bosdyn_api.robot_command.BehaviorFaultError, Conflict,
     "the robot fell or has a behaviour fault; set it upright and clear the fault on the tablet"),
    (bosdyn_api.robot_command.DockedError, Conflict, "the robot is docked; undock it"),
    (bosdyn_api.image.UnknownImageSourceError, Unavailable,
     "a camera of the robot is gone; look at its faults on the tablet"),
    (bosdyn_api.image.ImageResponseError, Unavailable,
     "a camera of the robot gives no image now ({error}); try again"),
    (bosdyn_api.robot.UnregisteredServiceError, Unavailable,
     "the robot does not offer a service that is needed ({error}); it may still be starting, or "
     "have no arm"),
    (bosdyn_api.exceptions.PersistentRpcError, Unavailable,
     "the robot at {host} cannot be talked to ({error}); check HELIOS_SPOT_HOST, and "
     "HELIOS_SPOT_CA_FILE if you set it"),
    ((bosdyn_api.exceptions.RpcError, bosdyn_api.exceptions.ServerError), Unavailable,
     "no answer from the robot at {host}; check that it is on and the network reaches it. A walk "
     "ends by itself when it is not renewed"),
)  # fmt: skip


def translate(error: Exception, host: str, doing: str) -> HeliosError:
    """The typed error for an SDK error; `doing` completes "cannot …", such as "walk"."""
    for kinds, kind, sentence in _SENTENCES:
        if isinstance(error, kinds):
            said = sentence.format(host=host, owner=_owner(error), error=_short(error))
            return kind(f"cannot {doing}: {said}")
    return Internal(f"cannot {doing}: the robot said {_short(error)}")


@contextmanager
def doing(what: str, host: str) -> Iterator[None]:
    """Raise HeliosError in place of every SDK error of the block."""
    try:
        yield
    except _SDK_ERRORS as error:
        raise translate(error, host, what) from error


def _owner(error: Exception) -> str:
    response = getattr(error, "response", None)
    for path in (("lease_owner",), ("lease_use_result", "owner")):
        found = response
        for name in path:
            found = getattr(found, name, None)
        if name := getattr(found, "client_name", ""):
            return str(name)
    return "somebody else"


def _short(error: Exception) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text[:160]}" if text else type(error).__name__
