"""Driver of Boston Dynamics' Spot: `helios up --robot spot`. See docs/how-to/spot.md."""
