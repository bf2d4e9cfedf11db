"""Settings of services: declared once, read from flags, then the environment, then a TOML file.

    class Settings(ServiceSettings):
        model_config = service_config("map2d")
        cell_m: float = Field(default=0.025, description="edge of a cell")

Flag `--cell-m 0.05`, variable `HELIOS_MAP2D_CELL_M=0.05`, or in the file that `--config FILE` or
`HELIOS_CONFIG` names: `[map2d]` `cell_m = 0.05`. The file's table `[all]` holds defaults for the
settings that every service has (router, certs, robot, log_level, log_format, tracing). No other
code in a service reads the environment, except for OpenTelemetry's own variables
(`span_recording`) and the folders of models (`models.model_folder`). A service with a setting
`agent` takes all settings not given from that agent's preset (`agent_presets`). Unknown names are
refused (`settings_spelling`).
"""

from __future__ import annotations

import os
import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, SecretStr, ValidationError
from pydantic_core import ErrorDetails, to_jsonable_python
from pydantic_settings import (
    BaseSettings,
    CliApp,
    EnvSettingsSource,
    InitSettingsSource,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
)

from helios_core.agent_presets import service_settings
from helios_core.errors import InvalidInput
from helios_core.log_format import LogFormat
from helios_core.name_rules import robot_name, robot_names
from helios_core.printable_text import plain_error
from helios_core.router_link import DEFAULT_ROUTER, RouterLink, router_link
from helios_core.settings_spelling import (
    OF_ALL,
    check_tables,
    check_variables,
    no_setting,
    variable,
)


def _robot(name: str) -> str:
    try:
        return robot_name(name)
    except InvalidInput as error:
        raise ValueError(error.message) from error


def _robots(text: str) -> str:
    try:
        return ",".join(robot_names(text))
    except InvalidInput as error:
        raise ValueError(error.message) from error


def _level(name: str) -> str:
    if name.lower() not in LOG_LEVELS:
        raise ValueError(f"no log level is called {name!r}; choose one of {', '.join(LOG_LEVELS)}")
    return name


LOG_LEVELS = ("debug", "info", "warning", "error")
LogLevel = Annotated[str, AfterValidator(_level)]
RobotName = Annotated[str, AfterValidator(_robot)]
RobotNames = Annotated[str, AfterValidator(_robots)]  # comma-separated, each once; may be empty


def service_config(service: str) -> SettingsConfigDict:
    """Configuration of a service's settings class: prefix of its variables, style of its flags."""
    return SettingsConfigDict(
        env_prefix=f"HELIOS_{service.upper()}_",
        cli_prog_name=f"helios-{service}",
        cli_kebab_case=True,
        cli_avoid_json=True,
        cli_implicit_flags=True,
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
    )


class ServiceSettings(BaseSettings):
    """Settings that every service has."""

    model_config = service_config("service")

    config: Path | None = Field(
        default=None, description="TOML file with one table per service; also HELIOS_CONFIG"
    )
    router: str = Field(
        default=DEFAULT_ROUTER,
        description="Zenoh endpoint of the router; with certs: by default the addresses there",
    )
    certs: Path | None = Field(
        default=None,
        description="folder of `helios certs`, or one session file of it: encrypts the bus",
    )
    robot: RobotName = Field(
        default="robot", description="name of the robot: the first part of every key"
    )
    log_level: LogLevel = Field(default="info", description="debug, info, warning or error")
    log_format: LogFormat = Field(
        default="text", description="form of log lines: text, or json for one object per line"
    )
    tracing: bool = Field(
        default=False,
        description="record spans for `helios why TASK --trace`; also on if OTEL_… variables name "
        "an exporter",
    )

    @classmethod
    def service_name(cls) -> str:
        """Name of the service in the file's tables and in variables."""
        return (
            str(cls.model_config.get("env_prefix", "")).removeprefix("HELIOS_").strip("_").lower()
        )

    def router_link(self, service: str) -> RouterLink:
        """Connection to the router, with the certificate of this service of `robot`.

        Raises InvalidInput if the certificates cannot be used.
        """
        chosen = self.certs is None or "router" in self.model_fields_set
        return router_link(self.router if chosen else "", self.certs, service, self.robot)

    def described(self) -> dict[str, dict[str, Any]]:
        """Value, default and description of each setting, as JSON values; secrets are masked."""
        values = self.model_dump(mode="json")
        return {
            name: {
                "value": values[name],
                "default": None
                if field.is_required()
                else to_jsonable_python(field.get_default(call_default_factory=True)),
                "description": field.description or "",
            }
            for name, field in type(self).model_fields.items()
        }

    @classmethod
    def load(cls, argv: Sequence[str] | None = None) -> Self:
        """Settings from the command line, environment and file. Exits 2 with a message if wrong."""
        args = list(sys.argv[1:] if argv is None else argv)
        try:
            return CliApp.run(cls, cli_args=args)._with_preset()
        except ValidationError as error:
            wrong = "; ".join(cls._said(e) for e in error.errors())
            print(f"helios-{cls.service_name()}: wrong setting: {wrong}", file=sys.stderr)
        except InvalidInput as error:
            print(f"helios-{cls.service_name()}: {error.message}", file=sys.stderr)
        except (OSError, ValueError) as error:
            print(f"helios-{cls.service_name()}: cannot read settings: {error}", file=sys.stderr)
        sys.exit(2)

    @classmethod
    def read(cls, **given: Any) -> Self:
        """Settings from the environment and the file, for programs without these flags; `given`
        goes before both.

        Raises InvalidInput that names each wrong setting, but never its value: it may be secret.
        """
        name = cls.service_name()
        try:
            return cls(**given)
        except ValidationError as error:
            wrong = "; ".join(
                f"{'.'.join(map(str, e['loc']))}: {plain_error(e['msg'])}".removeprefix(": ")
                for e in error.errors()
            )
            raise InvalidInput(
                f"wrong setting of {name}: {wrong}; correct {variable(name, '…')} or the settings "
                "file"
            ) from None
        except ValueError as error:  # a variable of a table that is no JSON
            raise InvalidInput(f"cannot read the settings of {name}: {error}") from None

    def _with_preset(self) -> Self:
        """Settings completed from the agent's preset where no flag, variable or file gives one."""
        agent = getattr(self, "agent", "")
        preset = service_settings(self.service_name(), agent).items()
        return self.model_copy(update={k: v for k, v in preset if k not in self.model_fields_set})

    @classmethod
    def _said(cls, error: ErrorDetails) -> str:
        name = ".".join(map(str, error["loc"]))
        if error["type"] == "extra_forbidden":
            return no_setting(cls.service_name(), cls.model_fields, name)
        field = cls.model_fields.get(name)
        secret = field is not None and field.annotation is SecretStr
        message = plain_error(error["msg"])
        return f"{name}: {message}" + ("" if secret else f" (got {error['input']!r})")

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        return init_settings, _Variables(cls), _File(cls)


def is_chosen(service: str, setting: str, environment: Mapping[str, str]) -> bool:
    """True if a variable, or the settings file that a variable names, has a value for a setting.

    False for a file that cannot be read: the service itself reports it.
    """
    values = {name.upper(): text for name, text in environment.items()}
    if variable(service, setting) in values:
        return True
    path = values.get(variable(service, "config")) or values.get("HELIOS_CONFIG")
    try:
        table = _toml(path).get(service) if path else None
    except InvalidInput:
        return False
    return isinstance(table, dict) and setting in table


def common_settings(service: str, environment: Mapping[str, str]) -> ServiceSettings:
    """Settings that every service has, with the values that a service takes from its variables and
    from the settings file. Raises InvalidInput."""
    values = {name.upper(): text for name, text in environment.items()}
    path = values.get(variable(service, "config")) or values.get("HELIOS_CONFIG")
    tables = _toml(path) if path else {}
    names = [name for name in ServiceSettings.model_fields if name != "config"]
    given: dict[str, Any] = {}
    for table in (tables.get(OF_ALL), tables.get(service)):
        given |= table if isinstance(table, dict) else {}
    given |= {n: values[variable(service, n)] for n in names if variable(service, n) in values}
    try:
        return ServiceSettings(**{n: v for n, v in given.items() if n in names})
    except ValidationError as error:
        message = plain_error(error.errors()[0]["msg"])
        raise InvalidInput(f"wrong setting of {service}: {message}") from error


class _Variables(EnvSettingsSource):
    """Source: the environment. Raises InvalidInput for a variable without a setting."""

    def __init__(self, settings_cls: type[ServiceSettings]) -> None:
        super().__init__(settings_cls)
        self._of = settings_cls

    def __call__(self) -> dict[str, Any]:
        check_variables(self._of.service_name(), self._of.model_fields, self.env_vars)
        return super().__call__()


class _File(InitSettingsSource):
    """Source: the settings file named by an earlier source, else by HELIOS_CONFIG."""

    def __init__(self, settings_cls: type[ServiceSettings]) -> None:
        super().__init__(settings_cls, {})
        self._of = settings_cls

    def __call__(self) -> dict[str, Any]:
        path = self.current_state.get("config") or os.environ.get("HELIOS_CONFIG")
        return _table(self._of, path) if path else {}


def _toml(path: str) -> dict[str, Any]:
    """Content of a TOML file. Raises InvalidInput that names the file, and the line of a fault."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InvalidInput(f"{path} is no TOML: {error}") from error
    except UnicodeDecodeError as error:
        raise InvalidInput(f"{path} is no UTF-8 text: {error.reason}") from error
    except OSError as error:
        raise InvalidInput(
            f"cannot read the settings file {path}: {error.strerror}; --config or HELIOS_CONFIG "
            "names it"
        ) from error


def _table(cls: type[ServiceSettings], path: str) -> dict[str, Any]:
    tables = _toml(path)
    check_tables(cls.service_name(), tables, path)
    of_all = tables.get(OF_ALL, {})
    common = {name for name in ServiceSettings.model_fields if name != "config"}
    if unknown := sorted(set(of_all) - common):
        raise InvalidInput(
            f"table [{OF_ALL}] of {path} has {', '.join(unknown)}; it may hold what every service "
            f"has: {', '.join(sorted(common))}"
        )
    own = tables.get(cls.service_name(), {})
    if unknown := sorted(set(own) - set(cls.model_fields)):
        wrong = "; ".join(no_setting(cls.service_name(), cls.model_fields, n) for n in unknown)
        raise InvalidInput(f"{path}: {wrong}")
    return of_all | own
