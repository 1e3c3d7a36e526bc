"""Hands of rendered people: the left hand and forearm of the renderer's mesh, fingers bent and spread by its rig.

They are rendered alone as cut-outs (`render_hands.py`) and held before the faces of `render_people.py`, in the same
skin and light. Positions are in the renderer's units (decimetres, x right, y up, z to the viewer).
"""

from __future__ import annotations

import json
from typing import Any

import cv2
import numpy as np

from guise.aam.landmarks.schemes import NOSE_TIP
from guise.common.arrays import F64
from training.parsing_labels import OCCLUDER

MIN_ARM_DECIMETRES = 2.6  # from the body's middle: what lies farther out is rendered
POINTING_SHARE = 0.2  # of the hands, with one or two fingers stretched out
OWN_TONE_SHARE = 0.75  # of the people, whose hands are no lighter or darker than the face
_MAX_BEND_RADIANS = np.radians((55, 75, 50))  # of the three joints of a finger


class Hand:
    """The left hand of one person, posed by its rig."""

    def __init__(self, program: dict[str, Any], person: Any) -> None:
        human, assets = program["human"], program["assets"]
        base = human.base()
        chosen = (base.g == "body") & (base.v[base.f][:, :, 0] > MIN_ARM_DECIMETRES).all(1)
        fine, f, texture, ft = human.catmull_clark(base.f[chosen], base.ft[chosen], human.NB, len(base.vt))
        self.surface = human.Surface(fine, np.zeros((fine.shape[0], 3)), f, ft, texture @ base.vt)
        self._rest = person.base
        rig = json.loads(assets.core("rigs/default.mhskel"))
        weights = json.loads(assets.core("rigs/default_weights.mhw"))["weights"]
        self._bones = [[f"finger{k}-{j}.L" for j in (1, 2, 3)] for k in range(1, 6)]
        self._weights = {b: np.array(weights[b]) for chain in self._bones for b in chain}
        self._joints = {
            b: tuple(person.base[rig["joints"][rig["bones"][b][end]]].mean(0) for end in ("head", "tail"))
            for chain in self._bones
            for b in chain
        }
        roots = np.array([self._joints[chain[0]][0] for chain in self._bones])
        tips = np.array([self._joints[chain[2]][1] for chain in self._bones])
        self.middle = roots[1:].mean(0)
        along = tips[2] - roots[2]
        self.along = along / np.linalg.norm(along)
        across = roots[4] - roots[1]
        palm = np.cross(across, self.along)  # out of the palm: it looks down at rest
        self.palm = palm / np.linalg.norm(palm) * (-1 if palm[1] > 0 else 1)
        self._outwards = float(np.sign(np.cross(self.palm, self.along) @ across))

    def posed(self, rng: np.random.Generator) -> F64:
        """Vertices of the base mesh with the fingers bent, spread like a fan or closed, or some of them pointing."""
        v = self._rest.copy()
        curl, fan = rng.beta(0.7, 1.6), self._outwards * rng.uniform(-0.06, 0.2)
        pointing = rng.integers(1, 5, int(rng.integers(1, 3))) if rng.random() < POINTING_SHARE else ()
        for k, chain in enumerate(self._bones):
            bend = np.clip(curl + rng.normal(0, 0.15), 0, 1) * (0.5 if k == 0 else 1)
            if len(pointing) and k:
                bend = rng.uniform(0, 0.2) if k in pointing else rng.uniform(0.8, 1)
            elif k and rng.random() < 0.12:
                bend = float(rng.random())
            spread = rng.normal(0, 0.08) + fan * (k - 2 if k else -0.5)
            carried = np.eye(4)
            moved = np.zeros_like(v)
            total = np.zeros(len(v))
            for bone, most in zip(chain, _MAX_BEND_RADIANS, strict=True):
                head, tail = self._joints[bone]
                finger = (tail - head) / np.linalg.norm(tail - head)
                axis = np.cross(finger, self.palm)
                turn = cv2.Rodrigues(axis / np.linalg.norm(axis) * bend * most)[0]
                if bone == chain[0]:
                    turn = cv2.Rodrigues(self.palm * spread)[0] @ turn
                own = np.eye(4)
                own[:3, :3], own[:3, 3] = turn, head - turn @ head
                carried = carried @ own
                index, weight = self._weights[bone][:, 0].astype(int), self._weights[bone][:, 1]
                moved[index] += weight[:, None] * (self._rest[index] @ carried[:3, :3].T + carried[:3, 3])
                total[index] += weight
            share = np.clip(total, 0, 1)[:, None]
            v += share * (moved / np.maximum(total, 1e-9)[:, None] - v) * (total > 0)[:, None]
        return np.asarray(v)


def view(rng: np.random.Generator, hand: Hand, euler: Any, spread: tuple[float, float, float]) -> F64:
    """Rotation that shows the hand with its fingers roughly upwards, palm or back to the viewer or in between.

    spread : standard deviations of yaw, pitch and roll in degrees
    """
    facing = hand.palm if rng.random() < 0.5 else -hand.palm
    side = np.cross(hand.along, facing)
    upright = np.stack([side / np.linalg.norm(side), hand.along, facing])
    angles = rng.normal(0, spread)
    return np.asarray(euler(*map(float, angles)) @ upright)


class HandBeforeFace:
    """A hand, the renderer's actor that draws it, and the renderer's rotations from yaw, pitch and roll in degrees."""

    def __init__(self, hand: Hand, actor: Any, euler: Any) -> None:
        self.actor, self._hand, self._euler = actor, hand, euler

    @classmethod
    def of(cls, program: dict[str, Any], renderer: Any, who: Any, rng: np.random.Generator) -> HandBeforeFace:
        """The hand of a person; a quarter of the people show somebody else's, in another tone."""
        hand = Hand(program, who.p)
        looks = who.mats["body"]["u"] | {"lipcol": (1.0, 1.0, 1.0), "stub": 0.0}
        if rng.random() > OWN_TONE_SHARE:
            looks["tone"] = tuple(np.array(looks["tone"]) * np.exp(rng.normal(0, 0.4)))
        material = {**who.mats["body"], "kind": "SKIN", "u": looks}
        return cls(hand, skin_actor(program, renderer, hand, material), program["human"].euler)

    def place(self, rng: np.random.Generator, points: F64, camera: Any) -> None:
        """Put knuckles or fingers before any of the face's points (81, 3), near them or up to a decimetre away."""
        hand = self._hand
        turn = view(rng, hand, self._euler, (35, 25, 30))
        if rng.random() < 0.25:  # from the side or from above
            turn = self._euler(0, 0, rng.uniform(-150, 150)) @ turn
        target = points[int(rng.integers(len(points)))] + rng.normal(0, 0.15, 3)
        target[2] = max(target[2], points[NOSE_TIP, 2] - rng.uniform(0, 0.6)) + rng.uniform(0.1, 1.1)
        anchor = hand.middle + rng.uniform(-0.3, 0.9) * hand.along
        v = (hand.posed(rng) - anchor) @ turn.T + target
        places = hand.surface.positions(v)
        self.actor.upload({"prop": (places, hand.surface.normals(places))}, camera)


def skin_actor(program: dict[str, Any], renderer: Any, hand: Hand, material: dict[str, Any]) -> Any:
    """The renderer's actor that draws a hand, an occluder in the labels."""
    actor = program["render"].GpuActor(renderer, _Owner(hand.surface), {"prop": material})
    actor.parsing = {"prop": (OCCLUDER, 0.0)}
    return actor


class _Owner:
    """What the renderer's actors want to know of a prop."""

    def __init__(self, surface: Any) -> None:
        self.surf = {"prop": surface}
