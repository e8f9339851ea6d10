#version 450 core
#extension GL_ARB_compute_shader : require
#extension GL_ARB_shader_storage_buffer_object : require
layout(local_size_x = 64, local_size_y = 1, local_size_z = 1) in;

struct View {
    vec3 eye_high;
    float tolerance;
    vec3 eye_low;
    uint slot;
    vec3 tangent;
    uint layer;
    vec3 bitangent;
    uint face;
    vec3 normal;
    uint emitter;
    vec3 clip_x;
    uint first_row;
    vec3 clip_y;
    uint rows;
    vec3 clip_w;
    uint stamp;
    float near;
    uint mirrored;
    uint upside_down;
    vec4 portal;
    uvec4 unused[6];
};
struct Settings {
    uint resolution;
    uint patch_count;
    uint chunk_count;
    uint word_count;
    uint capacity;
    uint triangle_count;
    uint pyramid_stride;
    float slack;
    float tiny_slack;
    uint output_entries;
    uint looks_back;
    uint run_count;
    uint queue;
    uint tiles_each;
};
struct Vertex {
    float high_x;
    float high_y;
    float high_z;
    float low_x;
    float low_y;
    float low_z;
    uint front;
    uint back;
    float normal_x;
    float normal_y;
    float normal_z;
    float unused;
};
struct Chunk {
    vec3 center_high;
    uint first_index;
    vec3 center_low;
    uint index_count;
    vec3 half_sides;
    uint unused;
};
struct Triangle {
    vec3 corner;
    vec3 edges[2];
    vec3 normal;
    uint front;
    uint back;
};
struct Place {
    uvec2 at;
    uint face;
    float inverse_;
    vec3 direction;
};
const uint NOBODY = 4294967295u;

layout(std140, binding = 0) uniform View_block_0Compute { View _group_0_binding_0_cs; };

layout(std140, binding = 1) uniform Settings_block_1Compute { Settings _group_1_binding_1_cs; };

layout(std430, binding = 2) readonly buffer type_6_block_2Compute { View _group_1_binding_2_cs[]; };

layout(std430, binding = 3) readonly buffer type_7_block_3Compute { Chunk _group_1_binding_3_cs[]; };

layout(binding = 4) uniform sampler2DArray _group_1_binding_4_cs;

layout(std430, binding = 9) readonly buffer type_9_block_4Compute { uint _group_1_binding_9_cs[]; };

layout(binding = 11) uniform usampler2DArray _group_1_binding_11_cs;

layout(std430, binding = 14) buffer type_12_block_5Compute { uint _group_1_binding_14_cs[]; };

layout(std430, binding = 15) readonly buffer type_13_block_6Compute { Vertex _group_1_binding_15_cs[]; };

layout(std430, binding = 16) readonly buffer type_9_block_7Compute { uint _group_1_binding_16_cs[]; };

layout(std430, binding = 17) readonly buffer type_9_block_8Compute { uint _group_1_binding_17_cs[]; };

layout(std430, binding = 24) readonly buffer type_14_block_9Compute { float _group_1_binding_24_cs[]; };


vec3 relative(View v, vec3 high, vec3 low) {
    return ((high - v.eye_high) + (low - v.eye_low));
}

vec3 in_frame(View v_1, vec3 r) {
    float x = (((v_1.tangent.x * r.x) + (v_1.tangent.y * r.y)) + (v_1.tangent.z * r.z));
    float y = (((v_1.bitangent.x * r.x) + (v_1.bitangent.y * r.y)) + (v_1.bitangent.z * r.z));
    float z = (((v_1.normal.x * r.x) + (v_1.normal.y * r.y)) + (v_1.normal.z * r.z));
    float snap = (v_1.tolerance + ((abs(x) + abs(y)) * 9.536743e-7));
    return vec3(x, y, ((abs(z) <= snap) ? 0.0 : z));
}

vec3 on_face(View v_2, vec3 p) {
    return vec3((((v_2.clip_x.x * p.x) + (v_2.clip_x.y * p.y)) + (v_2.clip_x.z * p.z)), (((v_2.clip_y.x * p.x) + (v_2.clip_y.y * p.y)) + (v_2.clip_y.z * p.z)), (((v_2.clip_w.x * p.x) + (v_2.clip_w.y * p.y)) + (v_2.clip_w.z * p.z)));
}

vec4 clip_position(View v_3, vec3 high_1, vec3 low_1) {
    vec3 _e3 = relative(v_3, high_1, low_1);
    vec3 _e4 = in_frame(v_3, _e3);
    vec3 _e5 = on_face(v_3, _e4);
    return vec4(_e5.x, _e5.y, v_3.near, _e5.z);
}

vec4 plane_on_face(View v_4, vec3 high_2, vec3 low_2, vec3 normal) {
    vec3 _e4 = relative(v_4, high_2, low_2);
    float height = (((normal.x * _e4.x) + (normal.y * _e4.y)) + (normal.z * _e4.z));
    vec3 n = vec3((((v_4.tangent.x * normal.x) + (v_4.tangent.y * normal.y)) + (v_4.tangent.z * normal.z)), (((v_4.bitangent.x * normal.x) + (v_4.bitangent.y * normal.y)) + (v_4.bitangent.z * normal.z)), (((v_4.normal.x * normal.x) + (v_4.normal.y * normal.y)) + (v_4.normal.z * normal.z)));
    vec3 _e59 = on_face(v_4, n);
    vec3 q = vec3(_e59.x, ((v_4.upside_down == 1u) ? -(_e59.y) : _e59.y), _e59.z);
    float up = (0.25 * (q.y + q.z));
    vec3 coefficients = ((v_4.face == 0u) ? q : vec3(q.x, up, (up + q.z)));
    float error = ((((abs(_e4.x) + abs(_e4.y)) + abs(_e4.z)) * 2.3841858e-7) / abs(height));
    return vec4((coefficients * (v_4.near / height)), error);
}

float depth_of(View v_5, vec4 plane, vec4 position) {
    uint _e8 = _group_1_binding_1_cs.resolution;
    float x_1 = (((2.0 * position.x) / float(_e8)) - 1.0);
    float y_1 = (((2.0 * (position.y - float(v_5.first_row))) / float(v_5.rows)) - 1.0);
    float depth_2 = min(fma(plane.x, x_1, fma(plane.y, y_1, plane.z)), 1.0);
    return ((abs((depth_2 - position.z)) <= (0.0625 * position.z)) ? depth_2 : position.z);
}

float behind(vec4 plane_1, float depth) {
    return (depth * (0.9999981 - min(plane_1.w, 0.0009765625)));
}

vec3 turned(View v_6, vec3 d) {
    return vec3(dot(v_6.tangent, d), dot(v_6.bitangent, d), dot(v_6.normal, d));
}

Triangle triangle(View v_7, uint index) {
    uint _e7 = _group_1_binding_16_cs[(3u * index)];
    Vertex a = _group_1_binding_15_cs[_e7];
    uint _e17 = _group_1_binding_16_cs[((3u * index) + 1u)];
    Vertex b = _group_1_binding_15_cs[_e17];
    uint _e27 = _group_1_binding_16_cs[((3u * index) + 2u)];
    Vertex c = _group_1_binding_15_cs[_e27];
    vec3 high_3 = vec3(a.high_x, a.high_y, a.high_z);
    vec3 low_3 = vec3(a.low_x, a.low_y, a.low_z);
    vec3 to_b = ((vec3(b.high_x, b.high_y, b.high_z) - high_3) + (vec3(b.low_x, b.low_y, b.low_z) - low_3));
    vec3 to_c = ((vec3(c.high_x, c.high_y, c.high_z) - high_3) + (vec3(c.low_x, c.low_y, c.low_z) - low_3));
    vec3 _e60 = turned(v_7, to_b);
    vec3 _e61 = turned(v_7, to_c);
    vec3 edges[2] = vec3[2](_e60, _e61);
    vec3 _e63 = relative(v_7, high_3, low_3);
    vec3 _e64 = in_frame(v_7, _e63);
    return Triangle(_e64, edges, cross(edges[0], edges[1]), a.front, a.back);
}

float inverse_there(View v_8, uint patch_id, vec3 direction) {
    bool local_1 = false;
    bool local_2 = false;
    uint _e5 = _group_1_binding_17_cs[patch_id];
    Triangle _e6 = triangle(v_8, _e5);
    float inverse_ = (dot(_e6.normal, direction) / dot(_e6.normal, _e6.corner));
    if (!((inverse_ > 0.0))) {
        return 0.0;
    }
    vec3 p_2 = ((direction / vec3(inverse_)) - _e6.corner);
    float along_b = dot(cross(p_2, _e6.edges[1]), _e6.normal);
    float along_c = dot(cross(_e6.edges[0], p_2), _e6.normal);
    if (!((along_b < 0.0))) {
        local_1 = (along_c < 0.0);
    } else {
        local_1 = true;
    }
    bool _e39 = local_1;
    if (!(_e39)) {
        local_2 = ((along_b + along_c) > dot(_e6.normal, _e6.normal));
    } else {
        local_2 = true;
    }
    bool _e49 = local_2;
    if (_e49) {
        return 0.0;
    }
    return inverse_;
}

Place place(uint base, uint index_1) {
    uint face_1 = 0u;
    bool local_3 = false;
    float _e6 = _group_1_binding_24_cs[(6u * index_1)];
    float _e13 = _group_1_binding_24_cs[((6u * index_1) + 1u)];
    float _e20 = _group_1_binding_24_cs[((6u * index_1) + 2u)];
    vec3 high_4 = vec3(_e6, _e13, _e20);
    float _e28 = _group_1_binding_24_cs[((6u * index_1) + 3u)];
    float _e35 = _group_1_binding_24_cs[((6u * index_1) + 4u)];
    float _e42 = _group_1_binding_24_cs[((6u * index_1) + 5u)];
    vec3 low_4 = vec3(_e28, _e35, _e42);
    View _e46 = _group_1_binding_2_cs[base];
    View _e49 = _group_1_binding_2_cs[base];
    vec3 _e50 = relative(_e49, high_4, low_4);
    vec3 _e51 = in_frame(_e46, _e50);
    vec3 size = abs(_e51);
    if (!((size.z < size.x))) {
        local_3 = (size.z < size.y);
    } else {
        local_3 = true;
    }
    bool _e65 = local_3;
    if (_e65) {
        if ((size.x >= size.y)) {
            face_1 = ((_e51.x > 0.0) ? 1u : 2u);
        } else {
            face_1 = ((_e51.y > 0.0) ? 3u : 4u);
        }
    }
    uint _e82 = face_1;
    View v_9 = _group_1_binding_2_cs[(base + _e82)];
    vec3 _e86 = on_face(v_9, _e51);
    float _e94 = _group_1_binding_2_cs[base].tolerance;
    float inverse_1 = ((_e51.z <= _e94) ? 0.0 : (1.0 / _e86.z));
    uint _e100 = _group_1_binding_1_cs.resolution;
    vec2 extent = vec2(float(_e100), float(v_9.rows));
    uvec2 pixel = uvec2(clamp(((((_e86.xy * inverse_1) * 0.5) + vec2(0.5)) * extent), vec2(0.0), (extent - vec2(1.0))));
    uvec2 at = (pixel + uvec2(0u, v_9.first_row));
    uint _e124 = face_1;
    return Place(at, _e124, inverse_1, (_e51 * inverse_1));
}

uint in_front(uint base_1, uint index_2, Place p_1, float depth_1) {
    bool local_4 = false;
    bool local_5 = false;
    bool local_6 = false;
    bool local_7 = false;
    View v_10 = _group_1_binding_2_cs[(base_1 + p_1.face)];
    float _e14 = _group_1_binding_1_cs.tiny_slack;
    if (((v_10.near * p_1.inverse_) < (depth_1 / (1.0 + _e14)))) {
        return NOBODY;
    }
    Triangle _e20 = triangle(v_10, index_2);
    float behind_1 = dot(_e20.normal, _e20.corner);
    uint id_1 = ((behind_1 < 0.0) ? _e20.front : _e20.back);
    if (!((behind_1 == 0.0))) {
        uint _e36 = _group_1_binding_1_cs.patch_count;
        local_4 = (id_1 >= _e36);
    } else {
        local_4 = true;
    }
    bool _e39 = local_4;
    if (!(_e39)) {
        local_5 = (_e20.front == v_10.emitter);
    } else {
        local_5 = true;
    }
    bool _e47 = local_5;
    if (!(_e47)) {
        local_6 = (_e20.back == v_10.emitter);
    } else {
        local_6 = true;
    }
    bool _e55 = local_6;
    if (_e55) {
        return NOBODY;
    }
    uint _e61 = _group_1_binding_1_cs.word_count;
    uint word = atomicOr(_group_1_binding_14_cs[((v_10.layer * _e61) + (id_1 / 32u))], 0u);
    if ((((word >> (id_1 % 32u)) & 1u) != 0u)) {
        return NOBODY;
    }
    uvec4 _e82 = texelFetch(_group_1_binding_11_cs, ivec3(ivec2(p_1.at), int(v_10.layer)), 0);
    uint shown = _e82.x;
    uint _e86 = _group_1_binding_1_cs.patch_count;
    if ((shown < _e86)) {
        float _e92 = inverse_there(v_10, shown, p_1.direction);
        local_7 = (p_1.inverse_ < (_e92 * 0.99999));
    } else {
        local_7 = false;
    }
    bool _e97 = local_7;
    if (_e97) {
        return NOBODY;
    }
    return id_1;
}

void mark(uint layer, uint id) {
    if ((id != NOBODY)) {
        uint _e7 = _group_1_binding_1_cs.word_count;
        uint _e17 = atomicOr(_group_1_binding_14_cs[((layer * _e7) + (id / 32u))], (1u << (id % 32u)));
        return;
    } else {
        return;
    }
}

void main() {
    uint local = gl_LocalInvocationIndex;
    uvec3 group = gl_WorkGroupID;
    uint on = 0u;
    uint face = 0u;
    uint i = 0u;
    uint _e4 = _group_0_binding_0_cs.slot;
    uint base_2 = ((_e4 + group.y) * 5u);
    uint layer_1 = _group_1_binding_2_cs[base_2].layer;
    uint chunk = (group.x + (group.z * 32768u));
    uint _e20 = _group_1_binding_1_cs.chunk_count;
    if ((chunk >= _e20)) {
        return;
    }
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e44 = face;
            face = (_e44 + 1u);
        }
        loop_init = false;
        uint _e26 = face;
        if ((_e26 < 5u)) {
        } else {
            break;
        }
        {
            uint _e29 = on;
            uint _e33 = face;
            uint _e37 = _group_1_binding_1_cs.chunk_count;
            uint _e41 = _group_1_binding_9_cs[((((layer_1 * 5u) + _e33) * _e37) + chunk)];
            on = (_e29 | _e41);
        }
    }
    uint _e46 = on;
    if ((_e46 == 0u)) {
        return;
    }
    uint _e52 = _group_1_binding_3_cs[chunk].first_index;
    uint first = (_e52 / 3u);
    uint _e58 = _group_1_binding_3_cs[chunk].index_count;
    uint count = (_e58 / 3u);
    i = local;
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            uint _e80 = i;
            i = (_e80 + 64u);
        }
        loop_init_1 = false;
        uint _e62 = i;
        if ((_e62 < count)) {
        } else {
            break;
        }
        {
            uint _e64 = i;
            Place _e66 = place(base_2, (first + _e64));
            if ((_e66.inverse_ > 0.0)) {
                uint _e70 = i;
                vec4 _e77 = texelFetch(_group_1_binding_4_cs, ivec3(ivec2(_e66.at), int(layer_1)), 0);
                uint _e79 = in_front(base_2, (first + _e70), _e66, _e77.x);
                mark(layer_1, _e79);
            }
        }
    }
    return;
}

