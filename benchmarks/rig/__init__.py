"""Benchmarks of the rig that a face drives."""
