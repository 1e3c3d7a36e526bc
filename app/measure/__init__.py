"""How private and how useful a de-identified video is, measured against its original."""

from app.measure.faces import MeasureError
from app.measure.job import Request, measure

__all__ = ["MeasureError", "Request", "measure"]
