"""Tags that mark a written file as synthetic."""

from guise.common.version import version

DIGITAL_SOURCE_TYPE = "http://cv.iptc.org/newscodes/digitalsourcetype/compositeWithTrainedAlgorithmicMedia"


def synthetic_tags() -> dict[str, str]:
    """The container tags that state that a face is synthetic, and by what it was made."""
    return {
        "comment": f"Synthetic face: made with Guise {version()}",
        "digital_source_type": DIGITAL_SOURCE_TYPE,
    }
