"""Benchmarks of expression analogy between photographs."""
