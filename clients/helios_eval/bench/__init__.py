"""`helios bench`: times our kernels against common libraries that do the same work, in one run."""

from helios_eval.bench.benchmark_run import main

__all__ = ["main"]
