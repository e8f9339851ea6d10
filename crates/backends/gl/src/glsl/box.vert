#version 450 core
// Boxes of nodes, tested against the depths: 36 corners each, those of the k-th asked-about node from vertex 36 k on.

// One face of one hemicube: `View` of the shared shaders.
layout(std140, binding = 0) uniform View {
    vec3 eye_high; float tolerance;
    vec3 eye_low; uint slot;
    vec3 tangent; uint layer;
    vec3 bitangent; uint face;
    vec3 normal; uint emitter;
    vec3 clip_x; uint first_row;
    vec3 clip_y; uint rows;
    vec3 clip_w; uint stamp;
    float near;
} view;

// The middle in high and low parts, and half the sides; `low.w` is a box's widening, a part of its distance.
struct Box { vec4 high; vec4 low; vec4 half_sides; };
layout(std430, binding = 0) readonly buffer Boxes { Box boxes[]; };
layout(std430, binding = 30) readonly buffer Asked { uint asked[]; };
layout(location = 0) flat out uint place;

const int CORNERS[36] = int[36](
    0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1,
    2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3);

void main() {
    place = uint(gl_VertexID) / 36u;
    Box b = boxes[asked[place]];
    int corner = CORNERS[gl_VertexID % 36];
    vec3 middle = (b.high.xyz - view.eye_high) + (b.low.xyz - view.eye_low);
    vec3 side = vec3((corner & 1) != 0, (corner & 2) != 0, (corner & 4) != 0) * 2.0 - 1.0;
    // The widening is above all rounding, of this and of the triangles' depths.
    float far = length(middle) + length(b.half_sides.xyz);
    vec3 p = middle + side * (b.half_sides.xyz + far * b.low.w);
    vec3 frame = vec3(dot(view.tangent, p), dot(view.bitangent, p), dot(view.normal, p));
    gl_Position = vec4(dot(view.clip_x, frame), dot(view.clip_y, frame), view.near, dot(view.clip_w, frame));
}
