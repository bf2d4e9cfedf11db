"""The entry point of the command `helios`, and of `python -m helios_client`."""

import sys

from helios_client.quick_stop import main as quick_stop


def main() -> int:
    """Run the command line; the exit status."""
    status = quick_stop()
    if status is None:
        from helios_client.cli import main as full

        status = full()
    return status


if __name__ == "__main__":
    sys.exit(main())
