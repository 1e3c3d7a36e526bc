"""The commands `guise analogy image` and `animate`: file input and output around `guise.analogy.photo`."""
