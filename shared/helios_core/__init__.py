"""What every HELIOS process shares: messages, topics, the bus, geometry, settings, life cycle."""
