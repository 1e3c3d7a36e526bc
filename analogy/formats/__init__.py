"""Mesh files: OBJ, PLY, glTF and GLB, read and written back."""
