"""The ground floor: files, arrays, errors, progress.  Imports nothing else of Guise."""
