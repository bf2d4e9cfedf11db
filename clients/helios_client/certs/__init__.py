"""Certificates of the bus: an authority, a certificate for each name, and Zenoh's files."""
