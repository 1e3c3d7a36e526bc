"""Live: camera, file or stream in, the swapped picture out, in real time."""
