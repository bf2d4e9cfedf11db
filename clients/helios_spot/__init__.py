"""Boston Dynamics' Spot as a robot: `helios up --robot spot`. See docs/how-to/spot.md."""
