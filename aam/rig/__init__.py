"""ARKit's 52 coefficients of a face, frame by frame, and the turn of its head and eyes."""
