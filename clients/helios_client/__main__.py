"""Entry point of the command `helios` and of `python -m helios_client`."""

import sys

from helios_client.interrupt_signals import ignore_interrupts, noted_interrupts
from helios_client.quick_stop import main as quick_stop


def main() -> int:
    """Run the command line and return its exit status."""
    status = quick_stop()
    if status is not None:
        return status
    with noted_interrupts() as interrupts:
        from helios_client.cli import main as full
    if interrupts.came:
        print("helios: interrupted", file=sys.stderr)
        ignore_interrupts()
        return 130
    return full()


if __name__ == "__main__":
    sys.exit(main())
