"""How a turn of head or eye is told to others: rotations in the axes of glTF and of Unity (VMC).

A turn is yaw to the image's right, pitch up and roll to the image's right, degrees, as `HeadPose.angles`: the rotation
Rz(roll) Ry(-yaw) Rx(-pitch) in image axes, x right, y down, z away.
"""

from __future__ import annotations

import numpy as np

from guise.common.arrays import F64, Floating


def gltf_rotation(turn: Floating) -> F64:
    """(..., 4) quaternion x y z w of turns (..., 3) in glTF's axes: x to the person's left, y up, z out of the face.

    >>> gltf_rotation(np.array([90.0, 0, 0])).round(3).tolist()
    [0.0, 0.707, 0.0, 0.707]
    """
    yaw, pitch, roll = np.moveaxis(np.asarray(turn, np.float64), -1, 0)
    return _product(_product(_about(2, -roll), _about(1, yaw)), _about(0, -pitch))


def vmc_rotation(turn: Floating) -> F64:
    """(..., 4) likewise in Unity's axes: x to the person's right, y up, z out of the face; left-handed.

    >>> vmc_rotation(np.array([90.0, 0, 0])).round(3).tolist()[1::2]
    [-0.707, 0.707]
    """
    return gltf_rotation(turn) * (1, -1, -1, 1)


def rotated(rotation: Floating, by: Floating) -> F64:
    """The quaternion of `by` after `rotation`."""
    return _product(np.asarray(by, np.float64), np.asarray(rotation, np.float64))


def inverse(rotation: Floating) -> F64:
    """The rotation back."""
    return np.asarray(rotation, np.float64) * (-1, -1, -1, 1)


def turn_beside(turn: Floating, rest: Floating) -> F64:
    """(3,) the turn of a head in the axes of what it looks like when turned by `rest`.

    >>> turn_beside(np.array([30.0, 10, 0]), np.array([30.0, 0, 0])).round(3).tolist()
    [0.0, 10.0, 0.0]
    """
    from scipy.spatial.transform import Rotation

    turned, ahead = (
        Rotation.from_euler("ZYX", (roll, -yaw, -pitch), degrees=True) for yaw, pitch, roll in (turn, rest)
    )
    roll, yaw, pitch = (ahead.inv() * turned).as_euler("ZYX", degrees=True)
    return np.array([-yaw, -pitch, roll]) + 0.0


def _about(axis: int, degrees: F64) -> F64:
    half = np.radians(degrees) / 2
    found = np.zeros((*np.shape(half), 4))
    found[..., axis], found[..., 3] = np.sin(half), np.cos(half)
    return found


def _product(a: F64, b: F64) -> F64:
    """Hamilton's product: first b, then a."""
    ax, ay, az, aw = np.moveaxis(a, -1, 0)
    bx, by, bz, bw = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        -1,
    )
