"""People: models described and kept, and the recogniser that tells who is who."""
