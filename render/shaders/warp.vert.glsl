#version 330
// Pass 1: the mesh in the rectangle. Both inputs are already shifted to GL's pixel centres.
in vec2 position;
in vec2 uv;
noperspective out vec2 texel;

void main() {
    texel = uv;
    gl_Position = vec4(position, 0.0, 1.0);
}
