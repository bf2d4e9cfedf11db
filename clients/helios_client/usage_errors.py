"""Error type of wrong use of the command line."""

from helios_core.errors import HeliosError


class UsageError(HeliosError):
    """Wrong use of a command: exit status 2."""
