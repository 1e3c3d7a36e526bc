"""What stands behind `guise analogy image` and `animate`: from files through `analogy.photo` to files and reports."""
