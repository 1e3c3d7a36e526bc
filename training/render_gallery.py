"""Renders the clips from which the donors that ship with Guise are enrolled: fictional people, seen close.

    python -m training.render_gallery --program DIR --out PEOPLE [--only p01 p08]

DIR holds the renderer (see `render_people`), whose skin textures have some 130 texels across a face.  So that faces
hold up close, this script adds what is finer: pores, mottling, tiny spots and stubble of the skin by a tiled map in
the renderer's shader, stray hairs about brows that would end as if drawn, lashes as thin as lashes; and a face at rest
that neither frowns nor parts its lips.  Each PEOPLE/NAME/talk.mp4 holds visemes, expressions, blinks and turns of the
head, of 880 x 960 pixels, under soft light from the front.  What a face looks like at rest is path-traced
(`trace_gallery`).
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import av
import cv2
import numpy as np

from guise.common.arrays import U8
from training.gallery_people import gallery_people
from training.gallery_textures import SEED, TILES, at_rest, fine_skin, grown_brows, thin_lashes
from training.render_people import load_program

SIZE = 880, 960  # pixels
JAW_PIXELS = 410.0  # width of the jaw
FRAMES, FPS = 110, 30
TURN_DEGREES = 9.0
AO_DIRECTIONS = 160
LIGHT = {
    "dir": [(-0.25, 0.55, 1.0), (0.6, 0.25, 0.8), (-0.5, 0.5, -0.6)],
    "col": [(1.05, 1.04, 1.02), (0.55, 0.55, 0.55), (0.4, 0.4, 0.4)],
    "amb": [(0.60, 0.60, 0.61), (0.0, 0.0, 0.0), (0.10, 0.10, 0.10), (0.08, 0.08, 0.08)],
    "exposure": 0.92,
}
FINE_SKIN = """
  vec4 Q=texture(det,uv*TILES); float fl=1.-.7*X.b;
  g+=(Q.rg-vec2(.5))*fl*relief;
  alb*=1.+(Q.b-.5)*vec3(.9,1.,1.05)*fl*spots;
  alb*=1.+(Q.a-.5)*vec3(-.10,-.34,-.30)*fl*mottle;
  float hairs=.75+1.5*clamp((.5-Q.b)*4.,0.,1.);
  alb*=mix(vec3(1.),vec3(.50,.53,.58),clamp(stub*textureLod(aux,uv,3.).a*hairs,0.,1.));
"""
STUBBLE = "alb*=mix(vec3(1.),vec3(.50,.53,.58),stub*X.a);"  # of the renderer: its grain is coarse, with light specks


def add_fine_skin(render) -> None:
    """Let the renderer's shader of skin look at a tiled map beside the skin's own textures."""
    after = "g=sign(g)*g*g;"
    assert after in render.FS
    assert STUBBLE in render.FS
    fine = FINE_SKIN.replace("TILES", f"{TILES}.")
    shader = render.FS.replace(STUBBLE, "").replace(after, after + fine)
    render.FS = shader.replace(
        "uniform sampler2D tex;",
        "uniform sampler2D tex; uniform sampler2D det; uniform float relief, spots, mottle;",
        1,
    )


def dress(program, spec: dict, rng: np.random.Generator) -> None:
    """Change the renderer's textures before a person is made."""

    def image(path: str) -> U8:
        picture = program["image"](path)
        if path.startswith("eyebrows/"):
            return grown_brows(picture, rng, spec.get("strays", 260), spec.get("inner_ends", 0.6))
        return thin_lashes(picture) if path.startswith("eyelashes/") else picture

    program["assets"].image = image


def performance(program, rng: np.random.Generator) -> dict:
    """The renderer's curves of a person who speaks, raises and lowers the brows, smiles and looks about."""
    anim = program["anim"]
    length = FRAMES / FPS
    phonemes = [
        "m",
        "aI",
        "n",
        "oU",
        "t",
        "i",
        "f",
        "A",
        "S",
        "u",
        "l",
        "E",
        "v",
        "w",
        "a",
        "s",
        "k",
        "@",
        "b",
        "O",
    ]
    times = np.arange(0.5, length - 2.2, 0.1)
    spoken = [(float(t), phonemes[int(rng.integers(len(phonemes)))]) for t in times]
    loud = np.full(int(anim.SR * (times[-1] + 0.1)), 9000, np.int16)
    plan = [
        (0.7, "surprise", 0.45, 0.2, 0.1, 0.2), (1.4, "frown", 0.5, 0.2, 0.1, 0.2),
        (length - 2.2, "smile", 0.9, 0.3, 0.3, 0.3), (length - 1.1, "surprise", 0.8, 0.25, 0.2, 0.3),
    ]  # fmt: skip
    acted = anim.performance(FRAMES, rng, spoken, loud, 0.0, plan, yaw=TURN_DEGREES, pitch=5.0, roll=3.0)
    acted["yaw"] = TURN_DEGREES * np.sin(2 * np.pi * np.arange(FRAMES) / FRAMES)  # to both sides alike
    acted["weights"][:, -2:] -= np.median(acted["weights"][:, -2:], axis=0)  # of the gaze
    return dict(acted)


class Studio:
    """The renderer with the map of fine skin."""

    def __init__(self, program) -> None:
        self.program = program
        self.renderer = program["render"].Renderer()
        self.fine = self.renderer.texture(fine_skin(np.random.default_rng(SEED)))
        self.fine.filter = (9987, 9729)  # trilinear
        self.fine.repeat_x = self.fine.repeat_y = True

    def person(self, spec: dict):
        """The renderer's actor of a specification."""
        actor = self.program["actor"]
        dress(self.program, spec, np.random.default_rng(SEED + spec["seed"]))
        who = actor.Actor(self.renderer, spec)
        who.mats["body"]["u"].update(
            det=3, relief=spec.get("relief", 1.0), spots=spec.get("spots", 1.0), mottle=spec.get("mottle", 1.0),
        )  # fmt: skip
        return who

    def frame(self, who, camera, background, weights, turn, sway) -> U8:
        """One frame (h, w, 3)."""
        human = self.program["human"]
        pivot = who.p.J["neck01"] - [0, 3.0, 0]
        rotation = human.rotvec(np.radians(sway[:3]))
        who.place(
            at_rest(self.program, who.spec, weights),
            human.euler(*turn),
            (rotation, pivot - rotation @ pivot + sway[3:]),
            camera,
        )
        self.fine.use(3)
        return np.asarray(self.renderer.frame([who.g], camera, LIGHT, background), np.uint8)


def render(studio: Studio, spec: dict, folder: Path, stills: bool) -> None:
    """Write a person's clip, or the frame at rest only."""
    program, rng = studio.program, np.random.default_rng(SEED + spec["seed"])
    who = studio.person(spec)
    camera = who.camera(face_px=JAW_PIXELS, up=0.25)
    background = studio.renderer.texture(program["looks"].background(100 + spec["seed"]))
    if stills:
        picture = studio.frame(who, camera, background, who.zero, (0, 0, 0), np.zeros(6))
        cv2.imwrite(str(folder / f"{spec['name']}.png"), picture[..., ::-1])
        return
    acted = performance(program, rng)
    path = folder / spec["name"] / "talk.mp4"
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", FPS, {"crf": "12", "preset": "veryfast"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv444p"
        stream.thread_count = 1
        for k in range(FRAMES):
            turn = acted["yaw"][k], acted["pitch"][k], acted["roll"][k]
            picture = studio.frame(who, camera, background, acted["weights"][k], turn, acted["sway"][k])
            soft = cv2.GaussianBlur(picture, (0, 0), 0.5)
            out.mux(stream.encode(av.VideoFrame.from_ndarray(soft, "rgb24")))
        out.mux(stream.encode(None))


def main() -> None:
    """Render everybody, or those named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--program", type=Path, required=True, help="folder of the renderer")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", help="names of some of the people")
    parser.add_argument("--stills", action="store_true", help="only a picture of each at rest")
    options = parser.parse_args()
    program = load_program(options.program, SIZE[0], AO_DIRECTIONS)
    import anim
    import people

    program["anim"], program["image"] = anim, program["assets"].image
    program["render"].W, program["render"].H = SIZE
    program["render"].Camera.__init__.__defaults__ = (1290.0, *SIZE, (0, 0, 0))
    add_fine_skin(program["render"])
    options.out.mkdir(parents=True, exist_ok=True)
    studio = Studio(program)
    for spec in gallery_people(people.PEOPLE):
        if not options.only or spec["name"] in options.only:
            started = time.monotonic()
            render(studio, spec, options.out, options.stills)
            print(f"{spec['name']}  {time.monotonic() - started:.0f} s", flush=True)


if __name__ == "__main__":
    main()
