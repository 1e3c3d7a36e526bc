#version 330
// The nearest triangle's number (exact in a float up to 2^24) and the barycentric place in it.
noperspective in vec3 weights;
out vec4 seen;

void main() {
    seen = vec4(float(gl_PrimitiveID), weights);
}
