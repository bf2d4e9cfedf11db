"""Past keyframes that can be asked by text or by name."""
