#version 330
// Pass 1: the synthesised face, colour and alpha in one look-up.
uniform sampler2D face;
noperspective in vec2 texel;
out vec4 colour;

void main() {
    colour = texture(face, texel);
}
