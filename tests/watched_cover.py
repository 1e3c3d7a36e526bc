"""A cover that looks frame by frame, a frame of the first person with things over it, and parsings made up."""

import numpy as np
from drawing import pass_time
from made_up import SAMPLES
from models import model_file

from guise.aam.landmarks.schemes import LOWER_LIP_BOTTOM, NOSE_ROOT, NOSE_TIP
from guise.aam.model import Identity
from guise.aam.parameters import ParameterEstimator
from guise.aam.parsing import FaceClass, FaceParsing
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.face import PAUSE_SECONDS, FaceInFrame, Seen
from guise.app.drawing.look import Look
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.cover import Cover
from guise.app.media import Frame, open_input
from guise.common.arrays import F32, F64, U8
from guise.common.decay import FRAME_SECONDS

BLACK = np.zeros((8, 8, 3), np.uint8)
BLUE = np.array([30, 60, 200], np.uint8)
FRAMES = 6  # by which the memory has faded
PAUSE_FRAMES = round(PAUSE_SECONDS / FRAME_SECONDS)
SKIN_COLOUR, HAND_COLOUR = (200, 150, 130), (190, 145, 120)
HAIR_COLOUR, WALL_COLOUR = (50, 40, 35), (120, 140, 150)


class Watch:
    """A cover with what it remembers, looking frame by frame."""

    def __init__(
        self,
        person: Identity,
        *,
        only_objects: bool = False,
        keeps_hair: bool = False,
        beyond: F32 | None = None,
        watches_eyes: bool = True,
        beard: F32 | None = None,
    ) -> None:
        self.reference, self.texels = person.reference, ParameterEstimator(person.appearance).sampler
        self.cover = Cover(
            self.reference, self.texels, only_objects=only_objects, keeps_hair=keeps_hair, beyond=beyond,
            watches_eyes=watches_eyes, beard=beard,
        )  # fmt: skip
        self.memory = Memory()

    def __call__(
        self, rgb: U8, shape: F64, mesh: F64 | None = None, seconds: float = FRAME_SECONDS
    ) -> F32 | None:
        """What is left (h, w) of a face drawn at a mesh (81, 2), by default on the head itself."""
        pass_time(self.memory, seconds)
        frame, places = Frame.from_rgb(rgb), self.texels.positions(shape)
        colours = frame.sample_rgb(places)
        face = self.face = FaceInFrame(frame, shape, shape, seen=Seen(places, colours, colours))
        self.cover.look(face, self.memory)
        face.mesh = shape if mesh is None else mesh
        self.cover.share(face, self.memory)
        return face.canvas.share

    @property
    def visible(self) -> F32:
        assert self.face.seen.visible is not None
        return self.face.seen.visible


class Scene:
    """A frame of the first person with anything drawn over it, and what is found in front of the face."""

    def __init__(self, person: Identity) -> None:
        self.person, self.reference = person, person.reference
        self.watch = Watch(person)
        with open_input(SAMPLES / "p01" / "talk2.mp4") as clip:
            self.rgb = next(iter(clip)).rgb()
        self.shape = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"][0].astype(np.float64)
        self.places = self.watch.texels.positions(self.shape)

    def show(self, rgb: U8, frames: int = 1) -> F32 | None:
        """Of the drawn face, what is left (h, w)."""
        for _ in range(frames):
            left = self.watch(rgb, self.shape)
        return left

    def with_object(self) -> tuple[U8, int]:
        """A blue square from the upper lip down; and its upper edge."""
        rgb = self.rgb.copy()
        x, y = square(self.shape)
        rgb[y:, x - 45 : x + 45] = BLUE
        return rgb, y


def square(shape: F64) -> tuple[int, int]:
    """The middle of the upper edge of the object."""
    x, y = (shape[NOSE_TIP] + shape[LOWER_LIP_BOTTOM]) / 2
    return round(x), round(y)


def frames_with_an_object() -> tuple[list[U8], F64]:
    """Frames of the first person's second clip with a blue square over mouth and chin; and the true landmarks."""
    shapes = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"].astype(np.float64)
    pictures = []
    with open_input(SAMPLES / "p01" / "talk2.mp4") as clip:
        for frame in clip:
            rgb = frame.rgb()
            if frame.index:
                x, y = square(shapes[frame.index])
                rgb[y:, x - 30 : x + 30] = BLUE
            pictures.append(rgb)
            if frame.index == FRAMES:
                return pictures, shapes
    raise AssertionError


def drawn(source: Identity, look: Look) -> tuple[U8, U8, F64]:
    """The last frame before and after a swap by p06, and its true landmarks."""
    pictures, shapes = frames_with_an_object()
    with Engine(source, Donor.of(Identity.load(model_file("p06"))), None, look) as engine:
        for rgb, shape in zip(pictures, shapes, strict=False):
            frame = Frame.from_rgb(rgb.copy())
            engine.draw(frame, shape)
    return pictures[-1], frame.rgb(), shapes[len(pictures) - 1]


def fake_parsing(shown: FaceClass, x: slice, y: slice) -> FaceParsing:
    """Cells that lie on the reference frame's 64 x 64 first pixels: skin, and a rectangle of something else."""
    shares = np.zeros((len(FaceClass), 64, 64), np.float32)
    shares[FaceClass.SKIN] = 1
    shares[FaceClass.SKIN, y, x] = 0
    shares[shown, y, x] = 1
    return FaceParsing(shares, np.eye(2, 3), np.zeros((2, 4)))


def between_eyes(watch: Watch) -> tuple[int, int]:
    """Row and column on the reference grid."""
    x, y = np.round(watch.reference.points[NOSE_ROOT]).astype(int)
    return int(y), int(x)
