"""The program, whose studio learns nobody while there is a file FOLDER/hold: so a test can cancel before the end.

Then it learns quickly, on less, as how well is tested elsewhere (test_enrol, test_enrol_photos).
"""

import time
from pathlib import Path
from typing import Any

from models import QUICK, short_samples

from guise.app.enrolment.file import enrol_file
from guise.app.photos import enrol_photos
from guise.app.studio import people
from guise.app.studio.enrol_job import enrol_job
from guise.common.progress import Progress

HOLD = "hold"


def held_enrol(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Learn as soon as that is allowed."""
    while (Path(about["model"]).parents[1] / HOLD).exists():
        progress("held", 0.0)
        time.sleep(0.05)
    for function in (enrol_file, enrol_photos.enrol_photos):
        function.__kwdefaults__["options"] = QUICK
    enrol_photos.samples_folder = short_samples
    return enrol_job(about, folder, progress)


if __name__ == "__main__":
    from guise.app.cli.main import main

    people.enrol_job = held_enrol
    main()
