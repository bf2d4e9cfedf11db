"""`python -m helios_client` is `helios`."""

import sys

from helios_client.cli import main

if __name__ == "__main__":
    sys.exit(main())
