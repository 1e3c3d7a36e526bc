"""Facial expression analogy between photos (Song et al. 2007, section VI): S is to S' as T is to T'."""

from guise.analogy.photo.analogy import METHODS, MOUTHS, Method, Mouth, PhotoAnalogy
from guise.analogy.photo.pictures import PhotoError

__all__ = ["METHODS", "MOUTHS", "Method", "Mouth", "PhotoAnalogy", "PhotoError"]
