"""The studio's tasks at six screens in Chromium: what axe, the console and the layout say, and a picture of each step.

On every page its main task is done as a visitor would: photos and a clip are dropped, a swap and a de-identified copy
are made, a person is learned, landmarks are opened, an expression is copied, a camera is shown with another face
and drives a rig.
With --work the pictures stay in that folder, to be looked at.
"""

from __future__ import annotations

import argparse
import base64
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import urljoin

import av
from playwright.sync_api import Error as PlaywrightError

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.live.runs import SAMPLES
from benchmarks.live.visit import browser, studio
from guise.app.media import open_input
from guise.app.media.pictures import save_picture

SCREENS = ((360, 740), (768, 1024), (1024, 768), (1280, 720), (1440, 900), (1920, 1080))
SCHEMES = ("light", "dark")
CLIP_FRAMES = 24
LONG_MS = 300_000
SERIOUS = ("serious", "critical")
DROP = """(place, [data, name, type]) => {
  const files = new DataTransfer(), bytes = Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
  files.items.add(new File([bytes], name, { type }));
  place.dispatchEvent(new DragEvent("drop", { bubbles: true, cancelable: true, dataTransfer: files }));
}"""
BROKEN = """() => [...document.images].filter((one) => one.complete && one.getAttribute("src") && !one.naturalWidth)
  .map((one) => one.src)"""


class Visit:
    """A visitor, and what is found wrong at the screens that they look at."""

    def __init__(
        self, page: Any, address: str, files: Path, shots: Path, screens: Sequence[tuple[int, int]]
    ) -> None:
        self.page, self._address, self.files, self._shots, self._screens = (
            page,
            address,
            files,
            shots,
            screens,
        )
        self.faults: list[tuple[str, str, str]] = []
        self._at = ""
        page.on("console", lambda said: self._note("console", said.text) if said.type == "error" else None)
        page.on("pageerror", lambda error: self._note("console", str(error)))

    def go(self, path: str) -> None:
        """Open a page that takes files."""
        self.page.goto(urljoin(self._address, path))
        self.page.wait_for_function("window.did_handshake")

    def drop(self, name: str, place: int = 0) -> None:
        """Drop a file on the page."""
        file = self.files / name
        kind = "video/mp4" if file.suffix == ".mp4" else "image/png"
        data = base64.b64encode(file.read_bytes()).decode()
        self.page.locator("[data-drop]").nth(place).evaluate(DROP, [data, name, kind])

    def press(self, name: str) -> None:
        """Press a button."""
        self.page.get_by_role("button", name=name).first.click()

    def see(self, text: str) -> None:
        """Wait for words."""
        self.page.get_by_text(text).first.wait_for(timeout=LONG_MS)

    def look(self, step: str) -> None:
        """Look at the page at all screens, in light and in dark, whose screens differ in colours alone."""
        for width, height in self._screens:
            self.page.set_viewport_size({"width": width, "height": height})
            for scheme in SCHEMES:
                self.page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
                self.page.wait_for_timeout(400)
                self._at = f"{width}x{height} {scheme}, {step}"
                self.page.screenshot(path=self._shots / f"{step}_{width}x{height}_{scheme}.png")
                if self.page.evaluate("document.documentElement.scrollWidth") > width:
                    self._note("layout", "wider than the screen")
                for source in self.page.evaluate(BROKEN):
                    self._note("picture", source[:100])
                if scheme == SCHEMES[0] or (width, height) == self._screens[-1]:
                    self._ask_axe()

    def _ask_axe(self) -> None:
        from axe_playwright_python.sync_playwright import Axe

        for fault in Axe().run(self.page, options={"preload": False}).response["violations"]:
            if fault["impact"] in SERIOUS:
                self._note("axe", f"{fault['id']}: {fault['nodes'][0]['html'][:100]}")

    def do(self, task: Callable[[Visit], None]) -> None:
        """Do a task; one that cannot be done is a fault."""
        try:
            task(self)
        except PlaywrightError as error:
            self._note("task", f"{task.__name__}: {str(error).splitlines()[0]}")

    def _note(self, kind: str, what: str) -> None:
        self.faults.append((self._at, kind, what))


def start(visit: Visit) -> None:
    """The first page."""
    visit.go("/")
    visit.see("Try a sample")
    visit.look("start")


def swap(visit: Visit) -> None:
    """A photo, and a clip, get another face."""
    visit.go("/swap")
    visit.look("swap")
    for name, words in (("anna.png", "Photo swapped in"), ("anna.mp4", "frames swapped")):
        visit.go("/swap")
        visit.drop(name)
        visit.see("Drawn in")
        visit.look(f"swap_choose_{name[-3:]}")
        visit.press("Swap the")
        visit.see(words)
        visit.look(f"swap_result_{name[-3:]}")


def deidentify(visit: Visit) -> None:
    """A photo, and a clip, are de-identified."""
    visit.go("/deidentify")
    visit.look("deidentify")
    for name in ("anna.png", "anna.mp4"):
        visit.go("/deidentify")
        visit.drop(name)
        visit.see("Drawn in")
        visit.look(f"deidentify_review_{name[-3:]}")
        visit.press("Render")
        visit.see("Open the report")
        visit.look(f"deidentify_result_{name[-3:]}")


def people(visit: Visit) -> None:
    """Somebody is learned from a clip, and their landmarks are opened."""
    visit.go("/people")
    visit.look("people")
    visit.drop("anna.mp4")
    visit.page.get_by_text("The person shown here agreed").click(timeout=LONG_MS)
    visit.look("people_add")
    visit.press("Learn from this clip")
    visit.see("Quality:")
    visit.look("people_known")
    visit.go("/landmarks")
    visit.look("landmarks")
    visit.page.locator("a.choice").first.click()
    visit.page.get_by_role("button", name="Carry forward").wait_for(timeout=LONG_MS)
    visit.look("landmarks_edit")


def analogy(visit: Visit) -> None:
    """An expression goes to another photo; heads are dropped."""
    visit.go("/analogy")
    for place, name in enumerate(("anna.png", "anna_smiles.png", "ben.png")):
        visit.drop(name, place)
        visit.page.get_by_role("img", name=Path(name).stem, exact=True).first.wait_for(timeout=LONG_MS)
    visit.look("analogy")
    visit.press("Create")
    visit.see("Download picture")
    visit.page.get_by_role("heading", name="Results").scroll_into_view_if_needed()
    visit.look("analogy_result")
    visit.page.get_by_role("tab", name="Heads").click()
    visit.page.get_by_role("button", name="Transfer").wait_for()
    visit.look("analogy_heads")
    visit.drop("rig.glb", 2)
    visit.page.get_by_role("img", name="rig", exact=True).wait_for(timeout=LONG_MS)
    visit.press("Parts of the target")
    visit.see("Part 1 of")
    visit.look("analogy_parts")


def live(visit: Visit) -> None:
    """The camera is shown with another face."""
    visit.go("/live")
    visit.look("live")
    visit.press("Start")
    visit.page.get_by_role("button", name="Stop", exact=True).wait_for(timeout=LONG_MS)
    visit.page.wait_for_timeout(15_000)
    visit.look("live_on")
    visit.press("Stop")


def rig(visit: Visit) -> None:
    """The camera, then a clip, drives a head; the clip's curves are downloaded."""
    visit.go("/rig")
    visit.page.wait_for_function("guiseRig.morphs.length > 0")
    visit.look("rig")
    visit.press("Start")
    visit.page.get_by_role("button", name="Stop", exact=True).wait_for()
    visit.page.wait_for_timeout(5_000)
    visit.look("rig_on")
    visit.press("Calibrate")
    visit.see("1 of 5")
    visit.look("rig_calibrating")
    visit.press("Stop")
    visit.page.get_by_text("Coefficients").click()
    for place, name in enumerate(("rig.glb", "anna.mp4")):
        visit.drop(name, place)
        visit.page.get_by_role("group", name=("Head", "Clip")[place]).locator("img, video").first.wait_for()
    visit.press("Start")
    visit.see("Recordings")
    with visit.page.expect_download():
        visit.press("Animated GLB")
    visit.look("rig_recorded")


TASKS: tuple[Callable[[Visit], None], ...] = (start, swap, deidentify, people, analogy, live, rig)


def write_files(folder: Path) -> None:
    """A short clip of a sample person, photos of two, and a rig."""
    shutil.copy(SAMPLES / "heads" / "arkit.glb", folder / "rig.glb")
    for name, person, frame in (("anna", "p01", 0), ("anna_smiles", "p01", 60), ("ben", "p06", 0)):
        with open_input(SAMPLES / person / "talk.mp4") as media:
            save_picture(folder / f"{name}.png", next(islice(media, frame, None)).rgb())
    with av.open(str(SAMPLES / "p01" / "talk2.mp4")) as clip, av.open(str(folder / "anna.mp4"), "w") as out:
        new = out.add_stream("libx264", 30, width=640, height=480, pix_fmt="yuv420p")
        for picture in islice(clip.decode(video=0), CLIP_FRAMES):
            out.mux(new.encode(picture.reformat(format="yuv420p")))
        out.mux(new.encode(None))


@contextmanager
def visitor(folder: Path, shots: Path, screens: Sequence[tuple[int, int]]) -> Iterator[Visit]:
    """Somebody at a studio of their own, who has agreed."""
    camera = SAMPLES / "p01" / "talk.mp4"
    with studio(folder, folder / "people") as address, browser(camera, folder) as page:
        page.set_default_timeout(LONG_MS)
        page.goto(address)
        visit = Visit(page, address, folder, shots, screens)
        visit.look("consent")
        visit.press("I agree")
        page.locator("a.choice").first.wait_for()
        yield visit


def measure(options: argparse.Namespace) -> Report:
    """All tasks, each step of them at all screens."""
    tasks = [task for task in TASKS if not options.tasks or task.__name__ in options.tasks]
    with tempfile.TemporaryDirectory() as name:
        shots = options.work or Path(name)
        shots.mkdir(parents=True, exist_ok=True)
        write_files(Path(name))
        with visitor(Path(name), shots, SCREENS[:1] if options.quick else SCREENS) as visit:
            for task in tasks:
                visit.do(task)
                common.say(f"{task.__name__}: {len(visit.faults)} faults so far")
    rows = list(dict.fromkeys(visit.faults))
    return Report(
        "studio.screens", "The studio's tasks at six screens",
        [Criterion("faults by axe, console and layout", len(rows), "<=", 0)],
        [Table("Faults", ("where", "kind", "what"), rows)],
    )  # fmt: skip


if __name__ == "__main__":
    parser = common.arguments(__doc__)
    parser.add_argument("--tasks", nargs="*", help="only these, such as swap and live")
    common.run(measure, parser)
