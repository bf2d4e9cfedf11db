"""Recorder service: writes all messages of the bus to MCAP files."""
