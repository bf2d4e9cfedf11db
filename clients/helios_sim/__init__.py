"""The simulated world: homes by seed, physics, truth and metrics, and its robot driver."""
