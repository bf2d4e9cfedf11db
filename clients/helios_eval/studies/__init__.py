"""Programs of their own that measure one thing each; `docs/` says when to run which."""
