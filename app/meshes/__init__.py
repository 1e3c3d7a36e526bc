"""What stands behind `guise analogy mesh`: from files through `analogy` to files, pictures and reports."""
