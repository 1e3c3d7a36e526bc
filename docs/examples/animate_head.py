"""Give the expressions of one 3-D head to another.  NEUTRAL EXPRESSION... TARGET"""

import sys

import guise

neutral, *expressions, target = sys.argv[1:]
report = guise.transfer_mesh(neutral, expressions, target, overwrite=True)
print(report)
