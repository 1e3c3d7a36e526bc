"""Tags that mark a written file as synthetic."""

from guise.common.version import version

DIGITAL_SOURCE_TYPE = "http://cv.iptc.org/newscodes/digitalsourcetype/compositeWithTrainedAlgorithmicMedia"


def synthetic_tags() -> dict[str, str]:
    """The container tags that say that a face is synthetic, and who made it."""
    return {
        "comment": f"Synthetic face: made with Guise {version()}",
        "digital_source_type": DIGITAL_SOURCE_TYPE,
    }
