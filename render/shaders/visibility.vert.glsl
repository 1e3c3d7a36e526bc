#version 330
// Already shifted to GL's pixel centres; depth grows away from the viewer.
in vec3 position;

void main() {
    gl_Position = vec4(position, 1.0);
}
