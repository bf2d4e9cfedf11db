"""Error models of detectors: fitted from recordings or simulated homes, used by the object map."""
