"""The one error of the command line's own."""

from helios_core.errors import HeliosError


class UsageError(HeliosError):
    """The command was called wrongly: exit status 2."""
