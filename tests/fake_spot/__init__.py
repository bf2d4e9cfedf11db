"""A simulated Spot that speaks the real gRPC services: the unmodified SDK connects to it.

    python -m tests.fake_spot --folder /tmp/spot     # prints the settings to reach it with

docs/how-to/spot.md says what it proves and what it does not.
"""
