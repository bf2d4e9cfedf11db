"""From a frame to evidence: what is created, faded and counted (section 3.1.3, eq. 2 to 5)."""
