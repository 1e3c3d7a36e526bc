"""Benchmarks of people: one photo, several people, and the studio."""
