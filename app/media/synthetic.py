"""Tags that mark a written file as synthetic."""

from guise.common.version import VERSION

DIGITAL_SOURCE_TYPE = "http://cv.iptc.org/newscodes/digitalsourcetype/compositeWithTrainedAlgorithmicMedia"


def synthetic_tags(made_from: object = None) -> dict[str, str]:
    """The container tags that state that a face is synthetic, by what it was made, and from what if that is known."""
    source = f" from {made_from}" if made_from else ""
    return {
        "comment": f"Synthetic face: made with Guise {VERSION}{source}",
        "digital_source_type": DIGITAL_SOURCE_TYPE,
    }
