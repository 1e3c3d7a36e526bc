"""Running a de-identification: inputs, engines, resumption, many files."""
