"""Path-traces a still of each fictional person, from which the donors that ship with Guise get their skin.

    pip install bpy==5.0.1 scipy opencv-contrib-python-headless     # Python 3.11, an environment of its own
    pip install --no-deps .
    python -m training.trace_gallery --program DIR --out PEOPLE [--only p01 p08]

DIR holds the renderer (see `render_gallery`), of whose people only the meshes and the coarse colours of their skin are
taken.  Light wanders below the skin, brows are strands of hair, and lips have no bright rim.  Each
PEOPLE/NAME/traced.png has the 880 x 960 pixels of the person's clip, of which only the face, without hair, is traced,
in the light of an overcast sky with wide lamps near the camera.  It takes a minute and a half of one core.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

import bpy
import cv2
import numpy as np

from guise.aam.landmarks.schemes import CHIN, JAW, NOSE_ROOT, NOSE_TIP
from guise.common.arrays import F32, F64, U8
from training.gallery_people import gallery_people
from training.gallery_textures import (
    LUMINANCE,
    SEED,
    TILES,
    Card,
    Strands,
    at_rest,
    brow_strands,
    fine_planes,
    plain_lips,
    thin_lashes,
)
from training.tracing import WHITE, add_light

SIZE = 880, 960  # pixels
JAW_PIXELS = 410.0  # width of the jaw
DISTANCE, UP = 9.5, 0.25  # of the camera, decimetres
SAMPLES = 16
RIM_PIXELS = 6.0  # standard deviation, from which skin goes on beyond a head's outline
AROUND = 0.2  # of the width and the height of the 68 points, which is traced beside them
LAMPS = (((-1.5, 3.5, 8.5), 7.0, 800.0, WHITE), ((5.0, 2.0, 6.0), 6.0, 160.0, WHITE))
SKY, EXPOSURE = 0.50, 1.10


def linear(colour: U8) -> F32:
    """Linear light of an encoded colour, as the renderer of the clips has it."""
    c = colour.astype(np.float32) / 255
    return np.asarray(c * c * (0.82 + 0.18 * c), np.float32)


def encoded(light: F32) -> U8:
    """A picture of linear light, with the renderer's soft shoulder."""
    c = light * EXPOSURE
    c = c * (1 + 0.16 * c) / (1 + 0.62 * c) * 1.18
    return np.asarray(np.sqrt(np.clip(c * (1.06 - 0.06 * c), 0, 1)) * 255 + 0.5, np.uint8)


def continued(light: F32, shown: F32) -> F32:
    """A picture (h, w, 3) of a head, times its share (h, w), whose skin goes on where landmarks may lie beyond it."""
    near = (
        cv2.GaussianBlur(light, (0, 0), RIM_PIXELS)
        / np.maximum(cv2.GaussianBlur(shown, (0, 0), RIM_PIXELS), 1e-3)[..., None]
    )
    return np.asarray(light + near * (1 - shown[..., None]), np.float32)


def image(name: str, array: F32):
    """A picture (h, w, 1 to 4) of linear values for a material."""
    h, w = array.shape[:2]
    out = bpy.data.images.new(name, w, h, alpha=True, float_buffer=True)
    out.colorspace_settings.name = "Non-Color"
    rgba = np.ones((h, w, 4), np.float32)
    rgba[..., : array.shape[2]] = array
    out.pixels.foreach_set(rgba[::-1].ravel())
    return out


class Material:
    """A principled material whose colour is a picture, and what its nodes are called.

    inputs : the rest of the shader's, by their names with _ for spaces.
    """

    def __init__(self, name: str, array: F32 | None, **inputs) -> None:
        self.data = bpy.data.materials.new(name)
        self.data.use_nodes = True
        self.tree = self.data.node_tree
        self.surface = self.tree.nodes["Principled BSDF"]
        for key, value in inputs.items():
            self.surface.inputs[key.replace("_", " ")].default_value = value
        if array is not None:
            self.texture = self.picture(name, array)
            self.link(self.texture.outputs["Color"], self.surface.inputs["Base Color"])

    def node(self, kind: str, **settings):
        """A new node."""
        made = self.tree.nodes.new(kind)
        for key, value in settings.items():
            setattr(made, key, value)
        return made

    def link(self, a, b) -> None:
        self.tree.links.new(a, b)

    def picture(self, name: str, array: F32, tiles: int = 1):
        """A node of a picture, repeated."""
        made = self.node("ShaderNodeTexImage", image=image(name, array))
        if tiles > 1:
            scale = self.node("ShaderNodeVectorMath", operation="SCALE")
            scale.inputs["Scale"].default_value = tiles
            self.link(self.node("ShaderNodeTexCoord").outputs["UV"], scale.inputs[0])
            self.link(scale.outputs[0], made.inputs["Vector"])
        return made

    def calculated(self, operation: str, *values):
        """The output of arithmetic on vectors: outputs of nodes, numbers or triples."""
        made = self.node("ShaderNodeVectorMath", operation=operation)
        for place, value in zip(made.inputs, values, strict=False):
            if isinstance(value, bpy.types.NodeSocket):
                self.link(value, place)
            else:
                place.default_value = (value,) * 3 if isinstance(value, float) else value
        return made.outputs[0]


def skin(program: dict, spec: dict):
    """The material of the skin: coarse colours of a texture, lips without a rim, and fine tiled structure."""
    uv = program["landmarks"].uv()
    colours, aux = program["looks"].skin_maps(spec, uv)
    colour = linear(colours)
    grey = (colour @ LUMINANCE)[..., None]
    colour = (grey + (colour - grey) * spec["sat"]) * np.array(spec["tone"], np.float32)
    rng = np.random.default_rng(SEED + spec["seed"])
    lip_colour = np.array(spec.get("lipcol", (1, 0.86, 0.88)), np.float32)
    colour, lips = plain_lips(colour, uv, lip_colour, rng)
    stubble = aux[..., 3].astype(np.float32) / 255 * spec.get("stub", 0.0)
    varied = cv2.GaussianBlur(rng.standard_normal(lips.shape).astype(np.float32), (0, 0), 9.0)
    strength = np.clip(1 + 0.35 * varied / varied.std(), 0.2, 1.8) * (1 - lips)
    height, bright, mottle = fine_planes(np.random.default_rng(SEED))
    made = Material(
        "skin", colour * 1.05, Subsurface_Weight=1.0, Subsurface_Radius=(1.0, 0.36, 0.18), Subsurface_Scale=0.025,
        Specular_IOR_Level=0.36,
    )  # fmt: skip
    fine = made.picture("fine", np.dstack([bright, mottle, height]), TILES)
    coarse = made.picture("coarse", np.dstack([strength, stubble, lips]))
    parts = [made.node("ShaderNodeSeparateColor") for _ in range(2)]
    for part, whole in zip(parts, (fine, coarse), strict=True):
        made.link(whole.outputs["Color"], part.inputs[0])
    (bright, mottle, height), (strength, stubble, lips) = ([*part.outputs][:3] for part in parts)
    light = made.calculated("MULTIPLY", bright, strength)
    blood = made.calculated("MULTIPLY", mottle, strength)
    spots, blotches = 0.028 * spec.get("spots", 1.0), 0.042 * spec.get("mottle", 1.0)
    light = made.calculated("MULTIPLY_ADD", light, tuple(spots * x for x in (0.9, 1.0, 1.05)), 1.0)
    blood = made.calculated("MULTIPLY_ADD", blood, tuple(blotches * x for x in (-0.10, -0.34, -0.30)), 1.0)
    hairs = made.calculated("MAXIMUM", made.calculated("MULTIPLY_ADD", bright, -0.25, 0.75), 0.0)
    beard = made.calculated("MINIMUM", made.calculated("MULTIPLY", hairs, stubble), 1.0)
    beard = made.calculated("MULTIPLY_ADD", beard, (-0.50, -0.47, -0.42), 1.0)
    product = made.texture.outputs["Color"]
    for factor in (light, blood, beard):
        product = made.calculated("MULTIPLY", product, factor)
    made.link(product, made.surface.inputs["Base Color"])
    roughness = made.calculated("MULTIPLY_ADD", lips, -0.10, 0.50)
    made.link(roughness, made.surface.inputs["Roughness"])
    relief = made.calculated("MULTIPLY", height, strength)
    bump = made.node("ShaderNodeBump")
    bump.inputs["Strength"].default_value = 0.5 * spec.get("relief", 1.0)
    bump.inputs["Distance"].default_value = 0.0004  # decimetres of one deviation of the height
    made.link(relief, bump.inputs["Height"])
    made.link(bump.outputs["Normal"], made.surface.inputs["Normal"])
    return made.data


def eyes(program: dict, spec: dict):
    """Eyeball where the texture is opaque, a clear wet cornea where it is not."""
    picture = program["assets"].image(f"eyes/materials/{spec['eye']}.png")
    colour = linear(picture[..., :3])
    grey = (colour @ LUMINANCE)[..., None]
    colour = (grey + (colour - grey) * spec.get("eyesat", 0.55)) * np.array((0.60, 0.57, 0.555), np.float32)
    opaque = (picture[..., 3:4] >= 128).astype(np.float32)
    made = Material("eyes", np.dstack([colour, opaque]), Roughness=0.4, Specular_IOR_Level=0.1)
    gloss = made.node("ShaderNodeBsdfGlossy")
    gloss.inputs["Roughness"].default_value = 0.03
    fresnel = made.node("ShaderNodeFresnel")
    fresnel.inputs["IOR"].default_value = 1.2
    output = made.node("ShaderNodeBsdfTransparent").outputs[0]
    opaque, ball = made.texture.outputs["Alpha"], made.surface.outputs[0]
    for share, other in ((fresnel.outputs[0], gloss.outputs[0]), (opaque, ball)):
        mix = made.node("ShaderNodeMixShader")
        for place, value in zip(mix.inputs, (share, output, other), strict=True):
            made.link(value, place)
        output = mix.outputs[0]
    made.link(output, made.tree.nodes["Material Output"].inputs["Surface"])
    return made.data


def cards(name: str, picture: U8, tint, dark, gain: float, roughness: float = 0.5):
    """Hair and lashes: textured cards with alpha."""
    light = np.clip((linear(picture[..., :3]) @ LUMINANCE)[..., None] * gain, 0, 1.4)
    colour = (np.array(dark) + (np.array(tint) - np.array(dark)) * np.clip(light, 0, 1)) * (
        0.35 + 1.1 * light
    )
    array = np.dstack([np.clip(colour, 0, 1), picture[..., 3:4] / 255]).astype(np.float32)
    made = Material(name, array, Roughness=roughness, Specular_IOR_Level=0.3)
    made.link(made.texture.outputs["Alpha"], made.surface.inputs["Alpha"])
    return made.data


def materials(program: dict, spec: dict) -> dict:
    """The material of each surface."""
    picture = program["assets"].image
    wet = {"Roughness": 0.25, "Subsurface_Weight": 0.4, "Subsurface_Scale": 0.01}
    teeth = linear(picture("teeth/materials/teeth.png")[..., :3]) * np.float32((0.92, 0.86, 0.76))
    tongue = linear(picture("tongue/tongue01/tongue01_diffuse.png")[..., :3]) * np.float32((0.6, 0.38, 0.38))
    lashes = spec.get("lashes", "eyelashes01")
    dark = (0.02, 0.016, 0.014), (0.012, 0.01, 0.009)
    return {
        "body": skin(program, spec),
        "eyes": eyes(program, spec),
        "teeth": Material("teeth", teeth, **wet).data,
        "tongue": Material("tongue", tongue, **wet).data,
        "lashes": cards("lashes", thin_lashes(picture(f"eyelashes/{lashes}/{lashes}.png")), *dark, 1.0),
    }


def add_strands(strands: Strands, colours: tuple) -> None:
    """Hairs, thinner towards their tips, of which each has a colour between two."""
    count, knots = strands.points.shape[:2]
    data = bpy.data.hair_curves.new("brows")
    data.add_curves([knots] * count)
    data.attributes["position"].data.foreach_set("vector", strands.points.astype(np.float32).ravel())
    radius = data.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", strands.radii.astype(np.float32).ravel())
    made = Material("strands", None, Roughness=0.5, Specular_IOR_Level=0.3)
    ramp = made.node("ShaderNodeMix", data_type="RGBA")
    made.link(made.node("ShaderNodeHairInfo").outputs["Random"], ramp.inputs["Factor"])
    for place, colour in zip((6, 7), colours, strict=True):
        ramp.inputs[place].default_value = (*colour, 1)
    made.link(ramp.outputs[2], made.surface.inputs["Base Color"])
    data.materials.append(made.data)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("brows", data))


def add_camera(points: F64) -> F64:
    """The camera of the person's clip, and the middle of the face (68 points)."""
    scene = bpy.context.scene
    face = np.array([0, (points[NOSE_ROOT][1] + points[CHIN][1]) / 2, points[NOSE_TIP][2]])
    focal = JAW_PIXELS * DISTANCE / np.ptp(points[list(JAW), 0])
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.sensor_fit = "HORIZONTAL"
    camera.location, camera.data.angle = np.add(face, (0, UP, DISTANCE)), 2 * np.arctan(SIZE[0] / 2 / focal)
    scene.collection.objects.link(camera)
    scene.camera = camera
    seen = points[:, :2] - face[:2] - [0, UP]
    seen = 0.5 + seen * focal / (DISTANCE - points[:, 2:] + face[2]) / SIZE
    low, high = seen.min(0), seen.max(0)
    low, high = low - AROUND * (high - low), high + [AROUND, 2.5 * AROUND] * (high - low)
    scene.render.use_border = True
    scene.render.border_min_x, scene.render.border_min_y = np.maximum(low, 0)
    scene.render.border_max_x, scene.render.border_max_y = np.minimum(high, 1)
    return face


def trace(program: dict, spec: dict, samples: int, yaw: float) -> U8:
    """A picture of a person at rest."""
    human = program["human"]
    person = human.Person(spec)
    weights = at_rest(program, spec, np.zeros(len(human.WEIGHT_NAMES), np.float32))
    surfaces = person.surfaces(weights, human.euler(yaw, 0, 0))[0]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", samples, True
    scene.cycles.denoising_prefilter = "ACCURATE"
    scene.cycles.max_bounces, scene.cycles.transparent_max_bounces = 4, 8
    scene.cycles_curves.shape, scene.render.film_transparent = "RIBBONS", True
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.image_settings.file_format = "OPEN_EXR"
    for name, material in materials(program, spec).items():
        surface = person.surf[name]
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(surfaces[name][0][surface.vmap].tolist(), [], surface.tri.tolist())
        mesh.uv_layers.new(name="uv").data.foreach_set("uv", surface.uv[surface.tri.ravel()].ravel())
        mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
        mesh.materials.append(material)
        mesh.normals_split_custom_set_from_vertices(surfaces[name][1][surface.vmap].tolist())
        scene.collection.objects.link(bpy.data.objects.new(name, mesh))
    brows, (places, normals) = person.surf["brows"], surfaces["brows"]
    card = program["assets"].image(f"eyebrows/{spec['brows']}/{spec['brows']}.png")
    rng = np.random.default_rng(SEED + spec["seed"])
    strands = brow_strands(
        card, Card(brows.uv, places[brows.vmap], normals[brows.vmap], brows.tri), spec, rng
    )
    add_strands(strands, spec.get("browc", spec.get("hairc", program["people"].DKBROWN)))
    face = add_camera(program["landmarks"].points(person.base))
    add_light(face, LAMPS, SKY, gleams=False)  # dark skin would gleam at its rim
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "traced.exr")
        bpy.ops.render.render(write_still=True)
        *light, shown = cv2.split(
            np.asarray(cv2.imread(scene.render.filepath, cv2.IMREAD_UNCHANGED), np.float32)
        )
    return encoded(continued(np.dstack(light), shown))


def load_program(folder: Path) -> dict:
    """The renderer's modules that hold people, without its own drawing."""
    os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
    sys.path.insert(0, str(folder))
    import assets
    import human
    import landmarks
    import looks
    import people

    return {"assets": assets, "human": human, "landmarks": landmarks, "looks": looks, "people": people}


def main() -> None:
    """Trace everybody, or those named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--program", type=Path, required=True, help="folder of the renderer")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", help="names of some of the people")
    parser.add_argument("--samples", type=int, default=SAMPLES)
    parser.add_argument("--yaw", type=float, default=0.0, help="degrees by which heads are turned")
    options = parser.parse_args()
    program = load_program(options.program)
    for spec in gallery_people(program["people"].PEOPLE):
        if not options.only or spec["name"] in options.only:
            started = time.monotonic()
            path = options.out / spec["name"] / "traced.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), trace(program, spec, options.samples, options.yaw))
            print(f"{spec['name']}  {time.monotonic() - started:.0f} s", flush=True)


if __name__ == "__main__":
    main()
