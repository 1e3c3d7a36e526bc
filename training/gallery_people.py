"""The fictional people of the gallery, specified for the renderer: seven of its own, a little changed, and two.

spots, mottle : strength of the fine skin.   inner_brows, brows_raised, mouth_shut : of the face at rest.
strays, inner_ends : see `grown_brows`.
"""

from __future__ import annotations

from typing import Any

# What is changed in the renderer's people: brows that bend less, and skin.
CHANGES: dict[str, dict[str, Any]] = {
    "p01": {"brows": "eyebrow001", "inner_brows": 0.6, "brows_raised": 0.2, "mouth_shut": 0.06, "moles": 1},
    "p02": {"brows": "eyebrow004", "spots": 0.8, "mottle": 0.5},
    "p03": {"brows": "eyebrow001", "inner_brows": 0.3, "brows_raised": 0.1, "spots": 1.2, "mottle": 1.15},
    "p04": {"spots": 1.2, "mottle": 1.4, "moles": 5},
    "p05": {"spots": 1.3, "mottle": 0.7, "moles": 1},
    "p06": {
        "brows": "eyebrow001",
        "inner_ends": 0.25,
        "strays": 340,
        "spots": 0.9,
        "mottle": 1.0,
        "freckles": 0.1,
        "inner_brows": 0.35,
        "brows_raised": 0.15,
    },
    "p07": {"brows": "eyebrow009", "moles": 1, "inner_brows": 0.3, "inner_ends": 0.5, "strays": 300},
}

BLACK = (0.030, 0.026, 0.024), (0.008, 0.007, 0.006)

MORE: tuple[dict[str, Any], ...] = (
    {
        "name": "p08", "desc": "woman, about 35, South Asian", "inner_brows": 0.5,
        "race": {"caucasian": 0.65, "african": 0.1, "asian": 0.25},
        "male": 0.0, "age": 0.15, "weight": 0.05, "seed": 8, "tone": (0.74, 0.76, 0.80), "sat": 0.86, "redness": 0.25,
        "skin": {"young_lightskinned_female_diffuse3": 0.42, "middleage_darkskinned_female_diffuse": 0.58},
        "hair": "ponytail01", "hairc": BLACK, "brows": "eyebrow008", "eye": "brown_eye",
        "clothes": "female_casualsuit01", "clothc": (0.05, 0.20, 0.19), "lipcol": (0.95, 0.72, 0.74),
        "moles": 3, "spots": 1.3, "mottle": 1.0,
        "shape": {
            "head/head-oval": 0.45, "nose/nose-hump-incr": 0.2, "nose/nose-scale-depth-incr": 0.15,
            "lr:eyes/eye-scale-incr": 0.2, "mouth/mouth-lowerlip-volume-incr": 0.2, "chin/chin-triangle": 0.2,
        },
    },
    {
        "name": "p09", "desc": "man, about 38, Middle Eastern", "race": {"caucasian": 0.85, "african": 0.15},
        "male": 1.0, "age": 0.22, "weight": 0.2, "muscle": 0.1, "seed": 9, "tone": (0.72, 0.72, 0.73), "sat": 0.88,
        "skin": {"middleage_lightskinned_male_diffuse": 0.72, "young_darkskinned_male_diffuse": 0.28}, "redness": 0.4,
        "hair": "short04", "hairc": BLACK, "brows": "eyebrow012", "browc": BLACK, "eye": "brownlight_eye", "stub": 0.4,
        "clothes": "male_casualsuit05", "inner_ends": 0.4, "mouth_shut": 0.06, "moles": 2, "spots": 0.9,
        "shape": {
            "head/head-diamond": 0.3, "nose/nose-hump-incr": 0.35, "nose/nose-scale-vert-incr": 0.2,
            "chin/chin-width-incr": 0.2, "chin/chin-height-incr": 0.15, "lr:eyes/eye-bag-incr": 0.2,
        },
    },
)  # fmt: skip


def gallery_people(renderer_people: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The specifications of all, given the renderer's."""
    own = [{**spec, **CHANGES[spec["name"]]} for spec in renderer_people if spec["name"] in CHANGES]
    return [*own, *MORE]
