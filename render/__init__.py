"""Drawing the synthesised face: GL and NumPy compositors that agree."""
