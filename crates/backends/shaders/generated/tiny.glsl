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
    uvec4 unused[8];
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
    uint unused_0_;
    uint unused_1_;
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
    vec3 corners[3];
    float volume;
    uint front;
    uint back;
};
const float NEAR = 9.313226e-10;

layout(std140, binding = 0) uniform View_block_0Compute { View _group_0_binding_0_cs; };

layout(std140, binding = 1) uniform Settings_block_1Compute { Settings _group_1_binding_1_cs; };

layout(std430, binding = 2) readonly buffer type_5_block_2Compute { View _group_1_binding_2_cs[]; };

layout(std430, binding = 3) readonly buffer type_7_block_3Compute { Chunk _group_1_binding_3_cs[]; };

layout(binding = 4) uniform sampler2DArray _group_1_binding_4_cs;

layout(std430, binding = 9) readonly buffer type_9_block_4Compute { uint _group_1_binding_9_cs[]; };

layout(binding = 11) uniform usampler2DArray _group_1_binding_11_cs;

layout(std430, binding = 14) buffer type_12_block_5Compute { uint _group_1_binding_14_cs[]; };

layout(std430, binding = 15) readonly buffer type_13_block_6Compute { Vertex _group_1_binding_15_cs[]; };

layout(std430, binding = 16) readonly buffer type_9_block_7Compute { uint _group_1_binding_16_cs[]; };

layout(std430, binding = 17) readonly buffer type_9_block_8Compute { uint _group_1_binding_17_cs[]; };


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
    return vec4(_e5.x, _e5.y, NEAR, _e5.z);
}

Triangle triangle(View v_4, uint index) {
    Triangle t = Triangle(vec3[3](vec3(0.0), vec3(0.0), vec3(0.0)), 0.0, 0u, 0u);
    uint k = 0u;
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e39 = k;
            k = (_e39 + 1u);
        }
        loop_init = false;
        uint _e5 = k;
        if ((_e5 < 3u)) {
        } else {
            break;
        }
        {
            uint _e12 = k;
            uint _e15 = _group_1_binding_16_cs[((3u * index) + _e12)];
            Vertex c = _group_1_binding_15_cs[_e15];
            vec3 high_2 = vec3(c.high_x, c.high_y, c.high_z);
            vec3 low_2 = vec3(c.low_x, c.low_y, c.low_z);
            uint _e27 = k;
            vec3 _e29 = relative(v_4, high_2, low_2);
            vec3 _e30 = in_frame(v_4, _e29);
            t.corners[_e27] = _e30;
            uint _e31 = k;
            if ((_e31 == 0u)) {
                t.front = c.front;
                t.back = c.back;
            }
        }
    }
    vec3 _e44 = t.corners[0];
    vec3 _e47 = t.corners[1];
    vec3 _e50 = t.corners[2];
    t.volume = dot(_e44, cross(_e47, _e50));
    Triangle _e53 = t;
    return _e53;
}

float inverse_there(View v_5, uint patch_id, vec3 direction) {
    bool local_1 = false;
    bool local_2 = false;
    bool local_3 = false;
    uint _e5 = _group_1_binding_17_cs[patch_id];
    Triangle _e6 = triangle(v_5, _e5);
    float a = dot(cross(_e6.corners[1], _e6.corners[2]), direction);
    float b = dot(cross(_e6.corners[2], _e6.corners[0]), direction);
    float c_1 = dot(cross(_e6.corners[0], _e6.corners[1]), direction);
    if (!(((a * _e6.volume) < 0.0))) {
        local_1 = ((b * _e6.volume) < 0.0);
    } else {
        local_1 = true;
    }
    bool _e37 = local_1;
    if (!(_e37)) {
        local_2 = ((c_1 * _e6.volume) < 0.0);
    } else {
        local_2 = true;
    }
    bool _e46 = local_2;
    if (!(_e46)) {
        local_3 = (_e6.volume == 0.0);
    } else {
        local_3 = true;
    }
    bool _e54 = local_3;
    if (_e54) {
        return 0.0;
    }
    return max((((a + b) + c_1) / _e6.volume), 0.0);
}

bool is_in_front(uint base, uint index_1) {
    bool local_4 = false;
    bool local_5 = false;
    bool local_6 = false;
    uint face_1 = 0u;
    bool local_7 = false;
    View frame = _group_1_binding_2_cs[base];
    Triangle _e5 = triangle(frame, index_1);
    uint id = ((_e5.volume < 0.0) ? _e5.front : _e5.back);
    if (!((_e5.volume == 0.0))) {
        uint _e20 = _group_1_binding_1_cs.patch_count;
        local_4 = (id >= _e20);
    } else {
        local_4 = true;
    }
    bool _e23 = local_4;
    if (!(_e23)) {
        local_5 = (_e5.front == frame.emitter);
    } else {
        local_5 = true;
    }
    bool _e31 = local_5;
    if (!(_e31)) {
        local_6 = (_e5.back == frame.emitter);
    } else {
        local_6 = true;
    }
    bool _e39 = local_6;
    if (_e39) {
        return false;
    }
    uint _e45 = _group_1_binding_1_cs.word_count;
    uint word = atomicOr(_group_1_binding_14_cs[((frame.layer * _e45) + (id / 32u))], 0u);
    if ((((word >> (id % 32u)) & 1u) != 0u)) {
        return false;
    }
    vec3 centroid_ = (((_e5.corners[0] + _e5.corners[1]) + _e5.corners[2]) / vec3(3.0));
    if ((centroid_.z <= frame.tolerance)) {
        return false;
    }
    vec3 size = abs(centroid_);
    if (!((size.z < size.x))) {
        local_7 = (size.z < size.y);
    } else {
        local_7 = true;
    }
    bool _e88 = local_7;
    if (_e88) {
        if ((size.x >= size.y)) {
            face_1 = ((centroid_.x > 0.0) ? 1u : 2u);
        } else {
            face_1 = ((centroid_.y > 0.0) ? 3u : 4u);
        }
    }
    uint _e105 = face_1;
    View v_6 = _group_1_binding_2_cs[(base + _e105)];
    vec3 _e109 = on_face(v_6, centroid_);
    float inverse_ = (1.0 / _e109.z);
    uint _e115 = _group_1_binding_1_cs.resolution;
    vec2 extent = vec2(float(_e115), float(v_6.rows));
    ivec2 pixel = ivec2(clamp(((((_e109.xy * inverse_) * 0.5) + vec2(0.5)) * extent), vec2(0.0), (extent - vec2(1.0))));
    ivec2 at = (pixel + ivec2(0, int(v_6.first_row)));
    uvec4 _e144 = texelFetch(_group_1_binding_11_cs, ivec3(at, int(v_6.layer)), 0);
    uint shown = _e144.x;
    uint _e148 = _group_1_binding_1_cs.patch_count;
    if ((shown > _e148)) {
        return true;
    }
    float depth = (NEAR * inverse_);
    vec4 _e157 = texelFetch(_group_1_binding_4_cs, ivec3(at, int(v_6.layer)), 0);
    float _e161 = _group_1_binding_1_cs.tiny_slack;
    if ((depth < (_e157.x / (1.0 + _e161)))) {
        return false;
    }
    uint _e169 = _group_1_binding_1_cs.patch_count;
    if ((shown == _e169)) {
        return true;
    }
    float _e173 = inverse_there(v_6, shown, (centroid_ * inverse_));
    return (inverse_ >= (_e173 * 0.99999));
}

void main() {
    uint local = gl_LocalInvocationIndex;
    uvec3 group = gl_WorkGroupID;
    uint on = 0u;
    uint face = 0u;
    uint i = 0u;
    uint _e4 = _group_0_binding_0_cs.slot;
    uint base_1 = ((_e4 + group.y) * 5u);
    uint layer = _group_1_binding_2_cs[base_1].layer;
    uint chunk = (group.x + (group.z * 32768u));
    uint _e20 = _group_1_binding_1_cs.chunk_count;
    if ((chunk >= _e20)) {
        return;
    }
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            uint _e44 = face;
            face = (_e44 + 1u);
        }
        loop_init_1 = false;
        uint _e26 = face;
        if ((_e26 < 5u)) {
        } else {
            break;
        }
        {
            uint _e29 = on;
            uint _e33 = face;
            uint _e37 = _group_1_binding_1_cs.chunk_count;
            uint _e41 = _group_1_binding_9_cs[((((layer * 5u) + _e33) * _e37) + chunk)];
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
    bool loop_init_2 = true;
    while(true) {
        if (!loop_init_2) {
            uint _e103 = i;
            i = (_e103 + 64u);
        }
        loop_init_2 = false;
        uint _e62 = i;
        if ((_e62 < count)) {
        } else {
            break;
        }
        {
            uint _e64 = i;
            bool _e66 = is_in_front(base_1, (first + _e64));
            if (_e66) {
                uint _e70 = i;
                uint _e74 = _group_1_binding_16_cs[(3u * (first + _e70))];
                Vertex c_2 = _group_1_binding_15_cs[_e74];
                View _e79 = _group_1_binding_2_cs[base_1];
                uint _e80 = i;
                Triangle _e82 = triangle(_e79, (first + _e80));
                uint id_1 = ((_e82.volume < 0.0) ? c_2.front : c_2.back);
                uint _e92 = _group_1_binding_1_cs.word_count;
                uint _e102 = atomicOr(_group_1_binding_14_cs[((layer * _e92) + (id_1 / 32u))], (1u << (id_1 % 32u)));
            }
        }
    }
    return;
}

