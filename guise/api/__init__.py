"""The Python API: what the commands do, for arrays and paths.

`import guise` gives all of it as `guise.enroll`, `guise.Swapper`, ...; docs/api.md is the tour.  Pictures are RGB uint8
(h, w, 3).  Paths may be text or `Path`.  Outputs appear only when they are complete and replace nothing unless
`overwrite` is true.
"""
