"""Map files: recovery after a crash, saving, loading, and formats of other programs."""
