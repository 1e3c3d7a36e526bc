#version 330
// Pass 2: alpha * warped + (1 - alpha) * frame. Where alpha is 0 the frame's eight bits come back unchanged.
// Where the mesh ends, alpha ends within a pixel: its share grows with how many of nine pixels are drawn.
uniform sampler2D warped;
uniform ivec2 size;  // of what is blended, a corner of the textures
uniform sampler2D frame;
uniform float opacity;
out vec4 colour;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 face = texelFetch(warped, pixel, 0);
    float drawn = 0.0;
    for (int y = -1; y <= 1; y++)
        for (int x = -1; x <= 1; x++)
            drawn += min(96.0 * texelFetch(warped, clamp(pixel + ivec2(x, y), ivec2(0), size - 1), 0).a, 1.0);
    float share = clamp(drawn * (2.0 / 9.0) - 1.0, 0.0, 1.0);
    vec3 behind = texelFetch(frame, pixel, 0).rgb;
    colour = vec4(mix(behind, face.rgb, face.a * share * opacity), 1.0);
}
