"""Benchmarks of `guise deidentify`."""
