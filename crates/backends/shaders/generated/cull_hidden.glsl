#version 450 core
#extension GL_ARB_compute_shader : require
#extension GL_ARB_shader_storage_buffer_object : require
layout(local_size_x = 128, local_size_y = 1, local_size_z = 1) in;

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
struct Projected {
    bool outside;
    float nearest;
    vec2 low;
    vec2 high;
};
const float NEAR = 9.313226e-10;
const uint GROUP = 128u;
const uint WORDS = 4u;
const uint OUTSIDE = 0u;
const uint HIDDEN = 1u;
const uint VISIBLE = 2u;

layout(std140, binding = 0) uniform View_block_0Compute { View _group_0_binding_0_cs; };

layout(std140, binding = 1) uniform Settings_block_1Compute { Settings _group_1_binding_1_cs; };

layout(std430, binding = 2) readonly buffer type_5_block_2Compute { View _group_1_binding_2_cs[]; };

layout(std430, binding = 3) readonly buffer type_7_block_3Compute { Chunk _group_1_binding_3_cs[]; };

layout(std430, binding = 5) readonly buffer type_8_block_4Compute { float _group_1_binding_5_cs[]; };

layout(std430, binding = 6) buffer type_9_block_5Compute { uint _group_1_binding_6_cs[]; };

layout(std430, binding = 7) buffer type_9_block_6Compute { uint _group_1_binding_7_cs[]; };

layout(std430, binding = 8) readonly buffer type_9_block_7Compute { uint _group_1_binding_8_cs[]; };

layout(std430, binding = 9) buffer type_9_block_8Compute { uint _group_1_binding_9_cs[]; };

layout(std430, binding = 10) buffer type_11_block_9Compute { uint _group_1_binding_10_cs[]; };

shared uint chosen[4];

shared uint sums[4];


vec3 relative(View v, vec3 high, vec3 low) {
    return ((high - v.eye_high) + (low - v.eye_low));
}

vec3 in_frame(View v_1, vec3 r) {
    float x_1 = (((v_1.tangent.x * r.x) + (v_1.tangent.y * r.y)) + (v_1.tangent.z * r.z));
    float y_1 = (((v_1.bitangent.x * r.x) + (v_1.bitangent.y * r.y)) + (v_1.bitangent.z * r.z));
    float z = (((v_1.normal.x * r.x) + (v_1.normal.y * r.y)) + (v_1.normal.z * r.z));
    float snap = (v_1.tolerance + ((abs(x_1) + abs(y_1)) * 9.536743e-7));
    return vec3(x_1, y_1, ((abs(z) <= snap) ? 0.0 : z));
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

Projected project(View v_4, Chunk chunk) {
    Projected p_1 = Projected(true, 0.0, vec2(3e38), vec2(-3e38));
    uint out_[5] = uint[5](0u, 0u, 0u, 0u, 0u);
    float nearest = 3e38;
    vec2 low_2 = vec2(3e38);
    vec2 high_2 = vec2(-3e38);
    uint k = 0u;
    bool local_3 = false;
    bool local_4 = false;
    bool local_5 = false;
    bool local_6 = false;
    vec3 _e12 = relative(v_4, chunk.center_high, chunk.center_low);
    vec3 h = chunk.half_sides;
    mat3x3 columns = mat3x3((vec3(v_4.tangent.x, v_4.bitangent.x, v_4.normal.x) * h.x), (vec3(v_4.tangent.y, v_4.bitangent.y, v_4.normal.y) * h.y), (vec3(v_4.tangent.z, v_4.bitangent.z, v_4.normal.z) * h.z));
    vec3 center = vec3(dot(v_4.tangent, _e12), dot(v_4.bitangent, _e12), dot(v_4.normal, _e12));
    vec3 extent = ((abs(columns[0]) + abs(columns[1])) + abs(columns[2]));
    vec3 reach = (abs(center) + extent);
    float margin = (v_4.tolerance + (((reach.x + reach.y) + reach.z) * 7.6293945e-6));
    if (((center.z + extent.z) <= -(margin))) {
        Projected _e73 = p_1;
        return _e73;
    }
    vec3 _e74 = on_face(v_4, center);
    vec3 _e76 = on_face(v_4, columns[0]);
    vec3 _e78 = on_face(v_4, columns[1]);
    vec3 _e80 = on_face(v_4, columns[2]);
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e216 = k;
            k = (_e216 + 1u);
        }
        loop_init = false;
        uint _e98 = k;
        if ((_e98 < 8u)) {
        } else {
            break;
        }
        {
            uint _e101 = k;
            float sx = (((_e101 & 1u) != 0u) ? 1.0 : -1.0);
            uint _e109 = k;
            float sy = (((_e109 & 2u) != 0u) ? 1.0 : -1.0);
            uint _e117 = k;
            float sz = (((_e117 & 4u) != 0u) ? 1.0 : -1.0);
            vec3 q = (((_e74 + (sx * _e76)) + (sy * _e78)) + (sz * _e80));
            uint _e132 = out_[0];
            out_[0] = (_e132 + uint((q.x < (-(q.z) - (4.0 * margin)))));
            uint _e143 = out_[1];
            out_[1] = (_e143 + uint((q.x > (q.z + (4.0 * margin)))));
            uint _e153 = out_[2];
            out_[2] = (_e153 + uint((q.y < (-(q.z) - (4.0 * margin)))));
            uint _e164 = out_[3];
            out_[3] = (_e164 + uint((q.y > (q.z + (4.0 * margin)))));
            uint _e174 = out_[4];
            out_[4] = (_e174 + uint((q.z < -(margin))));
            float _e180 = nearest;
            nearest = min(_e180, q.z);
            float w_low = (q.z - margin);
            float w_high = (q.z + margin);
            vec2 a = (q.xy - vec2((3.0 * margin)));
            vec2 b = (q.xy + vec2((3.0 * margin)));
            vec2 _e197 = low_2;
            low_2 = min(_e197, (a / mix(vec2(w_high), vec2(w_low), lessThan(a, vec2(0.0)))));
            vec2 _e206 = high_2;
            high_2 = max(_e206, (b / mix(vec2(w_low), vec2(w_high), lessThan(b, vec2(0.0)))));
        }
    }
    uint _e219 = out_[0];
    if (!((_e219 == 8u))) {
        uint _e226 = out_[1];
        local_3 = (_e226 == 8u);
    } else {
        local_3 = true;
    }
    bool _e230 = local_3;
    if (!(_e230)) {
        uint _e235 = out_[2];
        local_4 = (_e235 == 8u);
    } else {
        local_4 = true;
    }
    bool _e239 = local_4;
    if (!(_e239)) {
        uint _e244 = out_[3];
        local_5 = (_e244 == 8u);
    } else {
        local_5 = true;
    }
    bool _e248 = local_5;
    if (!(_e248)) {
        uint _e253 = out_[4];
        local_6 = (_e253 == 8u);
    } else {
        local_6 = true;
    }
    bool _e257 = local_6;
    if (_e257) {
        Projected _e258 = p_1;
        return _e258;
    }
    p_1.outside = false;
    float _e261 = nearest;
    nearest = (_e261 - margin);
    float _e263 = nearest;
    if ((_e263 > (16.0 * margin))) {
        float _e268 = nearest;
        p_1.nearest = _e268;
        vec2 _e270 = low_2;
        p_1.low = _e270;
        vec2 _e272 = high_2;
        p_1.high = _e272;
    }
    Projected _e273 = p_1;
    return _e273;
}

bool is_hidden(View v_5, Projected p_2) {
    uint base = 0u;
    uint shift = 2u;
    uint pitch = 0u;
    uint y = 0u;
    uint x = 0u;
    uint _e4 = _group_1_binding_1_cs.resolution;
    vec2 size = vec2(float(_e4), float(v_5.rows));
    uvec2 first = uvec2(clamp(((((p_2.low * 0.5) + vec2(0.5)) * size) - vec2(0.05)), vec2(0.0), (size - vec2(1.0))));
    uvec2 last = uvec2(clamp(((((p_2.high * 0.5) + vec2(0.5)) * size) + vec2(0.05)), vec2(0.0), (size - vec2(1.0))));
    float _e48 = _group_1_binding_1_cs.slack;
    float bound = ((NEAR / p_2.nearest) * _e48);
    uint _e52 = _group_1_binding_1_cs.resolution;
    uint across = (_e52 / 4u);
    uint _e58 = _group_1_binding_1_cs.pyramid_stride;
    base = (v_5.layer * _e58);
    pitch = across;
    uvec2 extent_1 = (last - first);
    if ((max(extent_1.x, extent_1.y) >= 24u)) {
        uint _e70 = base;
        base = (_e70 + ((3u * across) * across));
        shift = 4u;
        pitch = (across / 4u);
    }
    uvec2 row = uvec2(0u, v_5.first_row);
    uint _e82 = shift;
    uvec2 low_tile = ((first + row) >> uvec2(_e82));
    uint _e86 = shift;
    uvec2 high_tile = ((last + row) >> uvec2(_e86));
    y = low_tile.y;
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            uint _e115 = y;
            y = (_e115 + 1u);
        }
        loop_init_1 = false;
        uint _e91 = y;
        if ((_e91 <= high_tile.y)) {
        } else {
            break;
        }
        {
            x = low_tile.x;
            bool loop_init_2 = true;
            while(true) {
                if (!loop_init_2) {
                    uint _e112 = x;
                    x = (_e112 + 1u);
                }
                loop_init_2 = false;
                uint _e96 = x;
                if ((_e96 <= high_tile.x)) {
                } else {
                    break;
                }
                {
                    uint _e100 = base;
                    uint _e101 = y;
                    uint _e102 = pitch;
                    uint _e105 = x;
                    float _e108 = _group_1_binding_5_cs[((_e100 + (_e101 * _e102)) + _e105)];
                    if ((_e108 <= bound)) {
                        return false;
                    }
                }
            }
        }
    }
    return true;
}

uint outcome(View v_6, uint index, bool against_depths) {
    bool local_7 = false;
    bool local_8 = false;
    Chunk _e5 = _group_1_binding_3_cs[index];
    Projected _e6 = project(v_6, _e5);
    if (_e6.outside) {
        return OUTSIDE;
    }
    if (against_depths) {
        local_7 = (_e6.nearest > 0.0);
    } else {
        local_7 = false;
    }
    bool _e15 = local_7;
    if (_e15) {
        bool _e18 = is_hidden(v_6, _e6);
        local_8 = _e18;
    } else {
        local_8 = false;
    }
    bool _e20 = local_8;
    if (_e20) {
        return HIDDEN;
    }
    return VISIBLE;
}

void list(uint local_9, View v_7, bool only_seen, bool against_depths_1) {
    uint count = 0u;
    uint start = 0u;
    uint found = 0u;
    bool local_10 = false;
    uint before = 0u;
    uint w = 0u;
    uint face = ((v_7.layer * 5u) + v_7.face);
    if ((local_9 < 4u)) {
        atomicExchange(sums[local_9], 0u);
    }
    bool loop_init_3 = true;
    while(true) {
        if (!loop_init_3) {
            uint _e174 = start;
            start = (_e174 + GROUP);
        }
        loop_init_3 = false;
        uint _e18 = start;
        uint _e21 = _group_1_binding_1_cs.chunk_count;
        if ((_e18 < _e21)) {
        } else {
            break;
        }
        {
            if ((local_9 < WORDS)) {
                atomicExchange(chosen[local_9], 0u);
            }
            memoryBarrierShared();
            barrier();
            uint _e28 = start;
            uint index_1 = (_e28 + local_9);
            found = OUTSIDE;
            uint _e34 = _group_1_binding_1_cs.chunk_count;
            if ((index_1 < _e34)) {
                if (!(!(only_seen))) {
                    uint _e42 = _group_1_binding_8_cs[index_1];
                    local_10 = ((_e42 + 1u) == v_7.stamp);
                } else {
                    local_10 = true;
                }
                bool _e48 = local_10;
                if (_e48) {
                    uint _e49 = outcome(v_7, index_1, against_depths_1);
                    found = _e49;
                }
                if (!(only_seen)) {
                    uint _e54 = _group_1_binding_1_cs.chunk_count;
                    uint _e58 = found;
                    _group_1_binding_9_cs[((face * _e54) + index_1)] = uint((_e58 == VISIBLE));
                    uint _e62 = found;
                    if ((_e62 == OUTSIDE)) {
                        uint _e68 = atomicAdd(sums[0], 1u);
                    } else {
                        uint _e69 = found;
                        if ((_e69 == HIDDEN)) {
                            uint _e75 = atomicAdd(sums[1], 1u);
                        }
                    }
                }
                uint _e76 = found;
                if ((_e76 == VISIBLE)) {
                    uint _e87 = atomicOr(chosen[(local_9 / 32u)], (1u << (local_9 % 32u)));
                }
            }
            memoryBarrierShared();
            barrier();
            uint _e88 = count;
            before = _e88;
            w = 0u;
            bool loop_init_4 = true;
            while(true) {
                if (!loop_init_4) {
                    uint _e123 = w;
                    w = (_e123 + 1u);
                }
                loop_init_4 = false;
                uint _e92 = w;
                if ((_e92 < WORDS)) {
                } else {
                    break;
                }
                {
                    uint _e96 = w;
                    uint word = atomicOr(chosen[_e96], 0u);
                    uint all_ = uint(bitCount(word));
                    uint _e100 = w;
                    if ((_e100 < (local_9 / 32u))) {
                        uint _e104 = before;
                        before = (_e104 + all_);
                    } else {
                        uint _e106 = w;
                        if ((_e106 == (local_9 / 32u))) {
                            uint _e110 = before;
                            before = (_e110 + uint(bitCount((word & ((1u << (local_9 % 32u)) - 1u)))));
                        }
                    }
                    uint _e120 = count;
                    count = (_e120 + all_);
                }
            }
            uint _e125 = found;
            if ((_e125 == VISIBLE)) {
                uint _e130 = _group_1_binding_1_cs.chunk_count;
                uint _e132 = before;
                uint at = (((face * _e130) + _e132) * 5u);
                uint _e141 = _group_1_binding_3_cs[index_1].index_count;
                _group_1_binding_6_cs[at] = _e141;
                _group_1_binding_6_cs[(at + 1u)] = 1u;
                uint _e154 = _group_1_binding_3_cs[index_1].first_index;
                _group_1_binding_6_cs[(at + 2u)] = _e154;
                _group_1_binding_6_cs[(at + 3u)] = 0u;
                _group_1_binding_6_cs[(at + 4u)] = 0u;
                uint _e170 = _group_1_binding_3_cs[index_1].index_count;
                uint _e173 = atomicAdd(sums[2], (_e170 / 3u));
            }
            memoryBarrierShared();
            barrier();
        }
    }
    if ((local_9 == 0u)) {
        uint _e181 = count;
        _group_1_binding_7_cs[face] = _e181;
        uint tally = (v_7.layer * 8u);
        if (only_seen) {
            uint _e191 = atomicOr(sums[2], 0u);
            uint _e192 = atomicAdd(_group_1_binding_10_cs[(tally + 7u)], _e191);
            return;
        } else {
            uint _e199 = _group_1_binding_1_cs.chunk_count;
            uint _e200 = atomicAdd(_group_1_binding_10_cs[(tally + 3u)], _e199);
            uint _e207 = atomicOr(sums[0], 0u);
            uint _e208 = atomicAdd(_group_1_binding_10_cs[(tally + 4u)], _e207);
            uint _e215 = atomicOr(sums[1], 0u);
            uint _e216 = atomicAdd(_group_1_binding_10_cs[(tally + 5u)], _e215);
            uint _e223 = atomicOr(sums[2], 0u);
            uint _e224 = atomicAdd(_group_1_binding_10_cs[(tally + 6u)], _e223);
            return;
        }
    } else {
        return;
    }
}

void main() {
    if (gl_LocalInvocationID == uvec3(0u)) {
        chosen = uint[4](0u, 0u, 0u, 0u);
        sums = uint[4](0u, 0u, 0u, 0u);
    }
    memoryBarrierShared();
    barrier();
    uint local_1 = gl_LocalInvocationIndex;
    uvec3 group_1 = gl_WorkGroupID;
    uint _e5 = _group_0_binding_0_cs.slot;
    View _e13 = _group_1_binding_2_cs[(((_e5 + group_1.y) * 5u) + group_1.x)];
    list(local_1, _e13, false, true);
    return;
}

