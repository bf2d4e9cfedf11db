"""Where blending begins and ends, for every renderer."""

ALPHA_MIN = 1.0 / 255.0  # less counts as 0
OPACITY_MAX = 0.999  # more counts as this
COVERAGE_MIN = 1e-3  # less has no depth
TILE = 16  # pixels, both ways
