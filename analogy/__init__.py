"""Facial expression analogy, offline: expressions carried from one head or picture to another."""
