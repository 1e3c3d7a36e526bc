"""Active Appearance Models: landmarks, reference frame, training, tracking, expression transfer.

Pixels, x right, y down, pixel centres at integers; images RGB uint8 (docs/conventions.md).
"""
