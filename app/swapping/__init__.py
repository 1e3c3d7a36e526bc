"""Swapping: the engine, what it draws with, and whole files."""
