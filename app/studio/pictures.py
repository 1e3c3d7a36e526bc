"""Pictures inside of pages."""

from __future__ import annotations

import base64

from guise.app.media.images import encode_image
from guise.common.arrays import U8


def data_url(rgb: U8) -> str:
    """A picture (h, w, 3) as a data URL (JPEG)."""
    data = base64.b64encode(encode_image(rgb, None, ".jpg", {})).decode()
    return f"data:image/jpeg;base64,{data}"
