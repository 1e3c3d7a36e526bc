"""Landmarks of every face in a video: found, written to files, drawn."""
