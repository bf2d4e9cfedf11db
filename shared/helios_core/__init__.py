"""Code shared by all HELIOS processes: messages, topics, bus, geometry, settings, life cycle."""
