"""A Spot made of arithmetic that speaks the real services: the SDK talks to it unmodified.

    python -m tests.fake_spot --folder /tmp/spot     # prints the settings to reach it with

What it proves and what it does not: docs/how-to/spot.md.
"""
