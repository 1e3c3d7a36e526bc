"""What is said of a de-identification: reports, pages, the sheet for review."""
