"""Benchmarks of landmarkers: accuracy, detection rate, jitter, size and confidence, compared with peers."""
