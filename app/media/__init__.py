"""Video and image files in and out, exact in time, audio and colour."""
