"""The version of Guise."""

VERSION = "0.2.0"  # as in pyproject.toml: asking the installed package takes longer than most imports
