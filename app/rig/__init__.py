"""ARKit's coefficients of one person: of a clip to a file, and live to a receiver, a window and a file."""
