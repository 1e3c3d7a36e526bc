#version 330
// Three vertices a triangle, already shifted to GL's pixel centres; depth grows away from the viewer.
in vec3 position;
noperspective out vec3 weights;

void main() {
    int corner = gl_VertexID % 3;
    weights = vec3(corner == 0, corner == 1, corner == 2);
    gl_Position = vec4(position, 1.0);
}
