"""Tasks: storage, publication, pausing, execution and resumption after a crash."""
