"""`helios bench`: our kernels beside the same work done with common libraries, in one run."""

from helios_eval.bench.benchmark_run import main

__all__ = ["main"]
