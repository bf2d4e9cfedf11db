"""Writes all that goes over the bus into MCAP files."""
