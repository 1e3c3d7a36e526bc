"""Benchmarks of landmarkers: accuracy, finding, steadiness, speed, size and confidence, beside their peers."""
