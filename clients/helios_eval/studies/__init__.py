"""Stand-alone programs that each measure one property; `docs/` says when to run which."""
