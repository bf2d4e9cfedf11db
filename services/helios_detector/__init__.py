"""Detector service: detections, image-text scores and monocular depth of frames."""
