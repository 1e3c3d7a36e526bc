"""De-identification of videos: every face swapped with confidence or covered, and a report of it."""
