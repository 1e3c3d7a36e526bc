"""People: models described and kept, and the recogniser."""
