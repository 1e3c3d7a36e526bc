"""A moving picture of the studio: a browser whose camera shows a sample person, another face beside it.

Needs the extras `studio` and `dev`, and Chromium.
"""

from __future__ import annotations

import base64
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import urljoin

import cv2
import numpy as np

sys.path.append(str(Path(__file__).parents[1]))  # of the checkout
from benchmarks.live.visit import browser, studio
from guise.aam.model import Identity
from guise.app.media.pictures import Picture
from guise.app.people.kept import FOLDER_VARIABLE, place_for

VIEW = {"width": 1280, "height": 800}  # CSS pixels
PERSON, FACES = "Robin", ("Kenji (fictional)", "Mei (fictional)")
SECONDS_PER_FACE = 2.5
SETTLING_SECONDS = 3.0  # until the face is shown, and the bit rate of the connection is high enough
START_TIMEOUT_SECONDS = 60.0


def film_studio(folder: Path, model: Path, camera: Path, fps: float) -> list[Picture]:
    """Pictures of the page Live while the person of `model`, at the camera, is shown with one face and then another.

    folder : for the studio's files.   camera : the clip that the browser's camera shows.
    """
    os.environ[FOLDER_VARIABLE] = str(folder / "people")  # nobody else is shown
    replace(Identity.load(model), name=PERSON).save(place_for(PERSON))
    with (
        studio(folder / "studio", folder / "people") as address,
        browser(camera, folder, viewport=VIEW, color_scheme="light") as page,
    ):
        page.goto(address)
        page.get_by_role("button", name="I agree").click()
        page.locator("a.choice").first.wait_for()
        page.goto(urljoin(address, "/live"))
        return film_live(page, fps)


def film_live(page: Any, fps: float) -> list[Picture]:
    """Pictures of the page Live, which is open in a studio that knows PERSON, with one of FACES after the other."""
    page.get_by_role("combobox", name="Who is at the camera", exact=True).click()
    page.get_by_role("option", name=PERSON).click()
    _choose(page, FACES[0])
    page.get_by_role("button", name="Start").click()
    _wait(page, lambda: page.get_by_role("status").first.inner_text() == "")
    shots: list[Picture] = []
    for face in FACES:
        _choose(page, face)
        page.evaluate("window.scrollTo(0, 0)")
        page.wait_for_timeout(1000 * SETTLING_SECONDS)
        shots += _film(page, SECONDS_PER_FACE, fps)
    return shots


def _film(page: Any, seconds: float, fps: float) -> list[Picture]:
    """The page as it is seen, at a constant rate."""
    seen: list[tuple[float, str]] = []
    session = page.context.new_cdp_session(page)

    def keep(event: dict[str, Any]) -> None:
        seen.append((event["metadata"]["timestamp"], event["data"]))
        session.send("Page.screencastFrameAck", {"sessionId": event["sessionId"]})

    session.on("Page.screencastFrame", keep)
    session.send("Page.startScreencast", {"format": "jpeg", "quality": 92})
    page.wait_for_timeout(1000 * (seconds + 0.5))
    session.remove_listener("Page.screencastFrame", keep)
    session.detach()
    times = seen[0][0] + np.arange(0, seconds, 1 / fps)
    last = np.searchsorted([at for at, _ in seen], times, side="right") - 1
    return [_decoded(seen[k][1]) for k in last]


def _decoded(jpeg: str) -> Picture:
    data = np.frombuffer(base64.b64decode(jpeg), np.uint8)
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR_RGB), np.uint8)


def _choose(page: Any, face: str) -> None:
    page.get_by_role("group", name="Face to show").get_by_role("button", name=face).click()


def _wait(page: Any, condition: Callable[[], bool]) -> None:
    end = time.monotonic() + START_TIMEOUT_SECONDS
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(page.locator("body").inner_text())
        page.wait_for_timeout(250)
