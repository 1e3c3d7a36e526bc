"""Conversion between the ICC profiles of pictures, by Little CMS."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from guise.app.media.images import DeepImage, eight_bits

if TYPE_CHECKING:
    from PIL.ImageCms import ImageCmsProfile


class ProfileError(ValueError):
    """A colour profile that cannot be used."""


def converted(image: DeepImage, profile: bytes | None) -> DeepImage:
    """The picture in the colours of an RGB profile; None, here and in the picture, is sRGB.

    A picture with this profile stays as it is, as does grey without one; any other becomes RGB, 8 bits per component.

    Raises
    ------
    ProfileError
        When one of the profiles cannot be used.
    """
    if image.profile == profile:
        return image
    from PIL import Image, ImageCms

    grey = image.pixels.ndim == 2 and image.profile is not None
    picture = Image.fromarray(eight_bits(image.pixels) if grey else image.rgb8())
    try:
        made: Any = ImageCms.profileToProfile(
            picture, _opened(image.profile), _opened(profile), ImageCms.Intent.RELATIVE_COLORIMETRIC,
            outputMode="RGB", flags=ImageCms.Flags.BLACKPOINTCOMPENSATION,
        )  # fmt: skip
    except (ImageCms.PyCMSError, OSError) as error:
        raise ProfileError(str(error)) from error
    alpha = None if image.alpha is None else eight_bits(image.alpha)
    return DeepImage(np.asarray(made, np.uint8), alpha, profile)


def _opened(profile: bytes | None) -> ImageCmsProfile:
    from PIL import ImageCms

    if profile is None:
        return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB"))
    return ImageCms.ImageCmsProfile(io.BytesIO(profile))
