"""Benchmarks of `guise live` and of the studio's live page."""
