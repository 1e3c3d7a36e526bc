"""Benchmarks of the picture that `guise swap` makes."""
