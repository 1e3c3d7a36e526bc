"""How much of the expression several de-identified copies of a video keep.  ORIGINAL COPY..."""

import sys

import guise

original, *copies = sys.argv[1:]
result = guise.measure(original, copies)
for copy in result.as_json()["outputs"]:
    print(copy["output"], copy["utility"]["correlation"])
