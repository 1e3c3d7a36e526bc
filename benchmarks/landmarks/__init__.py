"""Benchmarks of landmarkers: accuracy, detection rate, jitter, speed, size and confidence, compared with peers."""
