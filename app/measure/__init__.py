"""How private and how useful a de-identified video is, measured against its original."""

from guise.app.measure.faces import MeasureError
from guise.app.measure.job import MeasureRequest, measure

__all__ = ["MeasureError", "MeasureRequest", "measure"]
