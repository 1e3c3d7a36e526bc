"""Benchmarks of people: crossings, cuts and second swaps."""
