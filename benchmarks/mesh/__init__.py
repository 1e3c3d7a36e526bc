"""Benchmarks of expression analogy on meshes, beside its peers."""
