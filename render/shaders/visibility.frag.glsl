#version 330
// The nearest triangle's number, exact in a float up to 2^24.
out float seen;

void main() {
    seen = float(gl_PrimitiveID);
}
