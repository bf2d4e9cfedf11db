"""Runs of many episodes: selection, parallel execution and common results."""
