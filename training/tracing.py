"""Light of a path-traced scene; needs Blender's bpy, which has an environment of its own."""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import mathutils
import numpy as np
from numpy.typing import ArrayLike

Lamp = tuple[tuple[float, float, float], float, float, tuple[float, float, float]]
WHITE = (1.0, 1.0, 1.0)


def add_light(middle: ArrayLike, lamps: Iterable[Lamp], sky: float, *, gleams: bool = True) -> None:
    """Square lamps that look at a place (3,), and an overcast sky.

    lamps : place from there, side, power and colour of each.   sky : its strength.   gleams : whether it is mirrored.
    """
    scene = bpy.context.scene
    for place, side, power, colour in lamps:
        lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "AREA"))
        lamp.data.size, lamp.data.energy, lamp.data.color = side, power, colour
        lamp.location = np.add(middle, place)
        lamp.rotation_euler = (-mathutils.Vector(place)).to_track_quat("-Z", "Y").to_euler()
        scene.collection.objects.link(lamp)
    scene.world = bpy.data.worlds.new("world")
    scene.world.use_nodes = True
    above = scene.world.node_tree.nodes["Background"].inputs
    above[0].default_value, above[1].default_value = (1, 1, 1, 1), sky
    scene.world.cycles_visibility.glossy = gleams
