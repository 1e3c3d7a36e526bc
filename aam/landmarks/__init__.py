"""Landmark sources: annotation files, ONNX models described by a card, face-box detectors."""
