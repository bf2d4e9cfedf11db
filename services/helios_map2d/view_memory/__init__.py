"""View memory: past keyframes that can be searched by text or by class name."""
