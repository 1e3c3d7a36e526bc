"""Benchmarks of `guise live`."""
