"""`helios up`: the processes of a stack, and the supervisor that keeps them running."""
