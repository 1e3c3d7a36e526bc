#version 330
// Pass 2: alpha * warped + (1 - alpha) * frame. Where alpha is 0 the frame's eight bits come back unchanged.
uniform sampler2D warped;
uniform sampler2D frame;
uniform float opacity;
out vec4 colour;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 face = texelFetch(warped, pixel, 0);
    vec3 behind = texelFetch(frame, pixel, 0).rgb;
    colour = vec4(mix(behind, face.rgb, face.a * opacity), 1.0);
}
