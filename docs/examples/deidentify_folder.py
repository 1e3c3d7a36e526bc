"""De-identify all videos of a folder, and list those that somebody should look at.  FOLDER OUTPUTS"""

import sys

import guise

folder, outputs = sys.argv[1:]
for file in guise.deidentify(folder, outputs, audio="mask", resume=True):
    if file.code:
        print(f"{file.input}: {file.sentence}")
