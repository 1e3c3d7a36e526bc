"""What is reported of a de-identification: reports, pages, the sheet for review."""
