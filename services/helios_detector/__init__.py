"""Detector and scorer: what a frame shows of what is sought."""
