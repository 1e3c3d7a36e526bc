"""What stands behind `guise analogy image` and `animate`: from files through `guise.analogy.photo` to files
and reports."""
