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
struct Projected {
    bool outside;
    float margin;
    vec3 middle;
    mat3x3 sides;
    vec3 offset;
    vec3 half_;
    float nearest;
};
struct Steps {
    vec3 by_x;
    vec3 by_y;
    vec3 middle;
    vec3 margin;
};
const float FAR_ERROR = 3.8146973e-6;
const uint GROUP = 128u;
const uint WORDS = 4u;
const uint OUTSIDE = 0u;
const uint HIDDEN = 1u;
const uint VISIBLE = 2u;

layout(std140, binding = 0) uniform View_block_0Compute { View _group_0_binding_0_cs; };

layout(std140, binding = 1) uniform Settings_block_1Compute { Settings _group_1_binding_1_cs; };

layout(std430, binding = 2) readonly buffer type_6_block_2Compute { View _group_1_binding_2_cs[]; };

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
    float x_2 = (((2.0 * position.x) / float(_e8)) - 1.0);
    float y_2 = (((2.0 * (position.y - float(v_5.first_row))) / float(v_5.rows)) - 1.0);
    float depth_1 = min(fma(plane.x, x_2, fma(plane.y, y_2, plane.z)), 1.0);
    return ((abs((depth_1 - position.z)) <= (0.0625 * position.z)) ? depth_1 : position.z);
}

float behind(vec4 plane_1, float depth) {
    return (depth * (0.9999981 - min(plane_1.w, 0.0009765625)));
}

float reach(mat3x3 sides, vec3 along) {
    return dot(abs((along * sides)), vec3(1.0));
}

Projected project(View v_6, Chunk chunk) {
    bool local_3 = false;
    bool local_4 = false;
    bool local_5 = false;
    bool local_6 = false;
    bool local_7 = false;
    vec3 _e4 = relative(v_6, chunk.center_high, chunk.center_low);
    vec3 h = chunk.half_sides;
    mat3x3 columns = mat3x3((vec3(v_6.tangent.x, v_6.bitangent.x, v_6.normal.x) * h.x), (vec3(v_6.tangent.y, v_6.bitangent.y, v_6.normal.y) * h.y), (vec3(v_6.tangent.z, v_6.bitangent.z, v_6.normal.z) * h.z));
    vec3 center = vec3(dot(v_6.tangent, _e4), dot(v_6.bitangent, _e4), dot(v_6.normal, _e4));
    vec3 extent = ((abs(columns[0]) + abs(columns[1])) + abs(columns[2]));
    vec3 far = (abs(center) + extent);
    float margin = (v_6.tolerance + (((far.x + far.y) + far.z) * 7.6293945e-6));
    vec3 _e60 = on_face(v_6, center);
    vec3 _e62 = on_face(v_6, columns[0]);
    vec3 _e64 = on_face(v_6, columns[1]);
    vec3 _e66 = on_face(v_6, columns[2]);
    mat3x3 sides_1 = mat3x3(_e62, _e64, _e66);
    if (!(((center.z + extent.z) <= -(margin)))) {
        float _e83 = reach(sides_1, vec3(1.0, 0.0, 1.0));
        local_3 = (((_e60.x + _e60.z) + _e83) < (-4.0 * margin));
    } else {
        local_3 = true;
    }
    bool _e89 = local_3;
    if (!(_e89)) {
        float _e100 = reach(sides_1, vec3(-1.0, 0.0, 1.0));
        local_4 = (((_e60.z - _e60.x) + _e100) < (-4.0 * margin));
    } else {
        local_4 = true;
    }
    bool _e106 = local_4;
    if (!(_e106)) {
        float _e117 = reach(sides_1, vec3(0.0, 1.0, 1.0));
        local_5 = (((_e60.y + _e60.z) + _e117) < (-4.0 * margin));
    } else {
        local_5 = true;
    }
    bool _e123 = local_5;
    if (!(_e123)) {
        float _e134 = reach(sides_1, vec3(0.0, -1.0, 1.0));
        local_6 = (((_e60.z - _e60.y) + _e134) < (-4.0 * margin));
    } else {
        local_6 = true;
    }
    bool _e140 = local_6;
    if (!(_e140)) {
        float _e149 = reach(sides_1, vec3(0.0, 0.0, 1.0));
        local_7 = ((_e60.z + _e149) < -(margin));
    } else {
        local_7 = true;
    }
    bool outside = local_7;
    float _e160 = reach(sides_1, vec3(0.0, 0.0, 1.0));
    float nearest = ((_e60.z - _e160) - margin);
    return Projected(outside, margin, _e60, sides_1, _e4, (h + vec3(margin)), ((nearest > (16.0 * margin)) ? nearest : -1.0));
}

Steps steps(View v_7) {
    vec3 for_x = cross(v_7.clip_y, v_7.clip_w);
    vec3 for_y = cross(v_7.clip_w, v_7.clip_x);
    vec3 for_w = cross(v_7.clip_x, v_7.clip_y);
    float scale = (1.0 / dot(v_7.clip_x, for_x));
    vec3 x_3 = (scale * (((for_x.x * v_7.tangent) + (for_x.y * v_7.bitangent)) + (for_x.z * v_7.normal)));
    vec3 y_3 = (scale * (((for_y.x * v_7.tangent) + (for_y.y * v_7.bitangent)) + (for_y.z * v_7.normal)));
    vec3 w_2 = (scale * (((for_w.x * v_7.tangent) + (for_w.y * v_7.bitangent)) + (for_w.z * v_7.normal)));
    return Steps(x_3, y_3, w_2, (((abs(x_3) + abs(y_3)) + abs(w_2)) * 1.9073486e-6));
}

float bound_through(View v_8, Steps s, Projected p_1, vec2 size, uvec2 first, uvec2 last) {
    float enter = 0.0;
    float leave = 3e38;
    uint k = 0u;
    vec2 low_4 = ((((vec2(first) - vec2(0.05)) / size) * 2.0) - vec2(1.0));
    vec2 high_4 = ((((vec2(last) + vec2(1.05)) / size) * 2.0) - vec2(1.0));
    vec2 middle = ((low_4 + high_4) * 0.5);
    vec2 half_ = ((high_4 - low_4) * 0.5);
    vec3 towards = mix(vec3(1.0), vec3(-1.0), lessThan(p_1.offset, vec3(0.0)));
    vec3 step_ = (towards * ((s.middle + (middle.x * s.by_x)) + (middle.y * s.by_y)));
    vec3 reach_1 = (((half_.x * abs(s.by_x)) + (half_.y * abs(s.by_y))) + s.margin);
    vec3 longest = (step_ + reach_1);
    vec3 shortest = (step_ - reach_1);
    vec3 begin = (abs(p_1.offset) - p_1.half_);
    vec3 end = (abs(p_1.offset) + p_1.half_);
    enter = p_1.nearest;
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e120 = k;
            k = (_e120 + 1u);
        }
        loop_init = false;
        uint _e78 = k;
        if ((_e78 < 3u)) {
        } else {
            break;
        }
        {
            uint _e81 = k;
            if ((begin[_e81] > 0.0)) {
                uint _e85 = k;
                if ((longest[_e85] <= 0.0)) {
                    return -1.0;
                }
                float _e90 = enter;
                uint _e91 = k;
                uint _e93 = k;
                enter = max(_e90, (begin[_e91] / longest[_e93]));
            } else {
                uint _e97 = k;
                if ((longest[_e97] < 0.0)) {
                    float _e101 = leave;
                    uint _e102 = k;
                    uint _e104 = k;
                    leave = min(_e101, (begin[_e102] / longest[_e104]));
                }
            }
            uint _e108 = k;
            if ((shortest[_e108] > 0.0)) {
                float _e112 = leave;
                uint _e113 = k;
                uint _e115 = k;
                leave = min(_e112, (end[_e113] / shortest[_e115]));
            }
        }
    }
    float _e122 = enter;
    float _e123 = leave;
    if ((_e122 > (_e123 * 1.0000019))) {
        return -1.0;
    }
    float _e131 = _group_1_binding_1_cs.slack;
    float _e132 = enter;
    return (v_8.near * ((_e131 / _e132) + (FAR_ERROR / p_1.nearest)));
}

bool is_hidden(View v_9, Projected p_2) {
    vec2 low_3 = vec2(3e38);
    vec2 high_3 = vec2(-3e38);
    uint k_1 = 0u;
    float sz = 0.0;
    uint y = 0u;
    uint x = 0u;
    bool local_8 = false;
    uint ty = 0u;
    uint tx = 0u;
    uint _e4 = _group_1_binding_1_cs.resolution;
    vec2 size_1 = vec2(float(_e4), float(v_9.rows));
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            uint _e95 = k_1;
            k_1 = (_e95 + 1u);
        }
        loop_init_1 = false;
        uint _e17 = k_1;
        if ((_e17 < 4u)) {
        } else {
            break;
        }
        {
            uint _e20 = k_1;
            float sx = (((_e20 & 1u) != 0u) ? 1.0 : -1.0);
            uint _e28 = k_1;
            float sy = (((_e28 & 2u) != 0u) ? 1.0 : -1.0);
            vec3 edge = ((p_2.middle + (sx * p_2.sides[0])) + (sy * p_2.sides[1]));
            sz = -1.0;
            bool loop_init_2 = true;
            while(true) {
                if (!loop_init_2) {
                    float _e91 = sz;
                    sz = (_e91 + 2.0);
                }
                loop_init_2 = false;
                float _e47 = sz;
                if ((_e47 < 2.0)) {
                } else {
                    break;
                }
                {
                    float _e50 = sz;
                    vec3 q_1 = (edge + (_e50 * p_2.sides[2]));
                    float w_low = (q_1.z - p_2.margin);
                    float w_high = (q_1.z + p_2.margin);
                    vec2 a = (q_1.xy - vec2((3.0 * p_2.margin)));
                    vec2 b = (q_1.xy + vec2((3.0 * p_2.margin)));
                    vec2 _e73 = low_3;
                    low_3 = min(_e73, (a / mix(vec2(w_high), vec2(w_low), lessThan(a, vec2(0.0)))));
                    vec2 _e82 = high_3;
                    high_3 = max(_e82, (b / mix(vec2(w_low), vec2(w_high), lessThan(b, vec2(0.0)))));
                }
            }
        }
    }
    vec2 _e97 = low_3;
    uvec2 first_2 = uvec2(clamp(((((_e97 * 0.5) + vec2(0.5)) * size_1) - vec2(0.05)), vec2(0.0), (size_1 - vec2(1.0))));
    vec2 _e114 = high_3;
    uvec2 last_1 = uvec2(clamp(((((_e114 * 0.5) + vec2(0.5)) * size_1) + vec2(0.05)), vec2(0.0), (size_1 - vec2(1.0))));
    Steps _e131 = steps(v_9);
    float _e134 = _group_1_binding_1_cs.slack;
    float bound = ((_e134 * v_9.near) / p_2.nearest);
    uint _e141 = _group_1_binding_1_cs.resolution;
    uint across = (_e141 / 4u);
    uint _e147 = _group_1_binding_1_cs.pyramid_stride;
    uint fine = (v_9.layer * _e147);
    uint coarse = (fine + ((3u * across) * across));
    uvec2 row = uvec2(0u, v_9.first_row);
    uvec2 from_first = (first_2 + row);
    uvec2 to_last = (last_1 + row);
    uvec2 low_square = (from_first >> uvec2(4u));
    uvec2 high_square = (to_last >> uvec2(4u));
    y = low_square.y;
    bool loop_init_3 = true;
    while(true) {
        if (!loop_init_3) {
            uint _e256 = y;
            y = (_e256 + 1u);
        }
        loop_init_3 = false;
        uint _e166 = y;
        if ((_e166 <= high_square.y)) {
        } else {
            break;
        }
        {
            x = low_square.x;
            bool loop_init_4 = true;
            while(true) {
                if (!loop_init_4) {
                    uint _e253 = x;
                    x = (_e253 + 1u);
                }
                loop_init_4 = false;
                uint _e171 = x;
                if ((_e171 <= high_square.x)) {
                } else {
                    break;
                }
                {
                    uint _e174 = x;
                    uint _e175 = y;
                    uvec2 square = (uvec2(_e174, _e175) << uvec2(4u));
                    uvec2 a_1 = max(square, from_first);
                    uvec2 b_1 = min((square + uvec2(15u)), to_last);
                    uint _e186 = y;
                    uint _e191 = x;
                    float behind_1 = _group_1_binding_5_cs[((coarse + (_e186 * (across / 4u))) + _e191)];
                    if (!((behind_1 > bound))) {
                        float _e201 = bound_through(v_9, _e131, p_2, size_1, (a_1 - row), (b_1 - row));
                        local_8 = (behind_1 > _e201);
                    } else {
                        local_8 = true;
                    }
                    bool _e204 = local_8;
                    if (_e204) {
                        continue;
                    }
                    uvec2 low_tile = (a_1 >> uvec2(2u));
                    uvec2 high_tile = (b_1 >> uvec2(2u));
                    ty = low_tile.y;
                    bool loop_init_5 = true;
                    while(true) {
                        if (!loop_init_5) {
                            uint _e250 = ty;
                            ty = (_e250 + 1u);
                        }
                        loop_init_5 = false;
                        uint _e213 = ty;
                        if ((_e213 <= high_tile.y)) {
                        } else {
                            break;
                        }
                        {
                            tx = low_tile.x;
                            bool loop_init_6 = true;
                            while(true) {
                                if (!loop_init_6) {
                                    uint _e247 = tx;
                                    tx = (_e247 + 1u);
                                }
                                loop_init_6 = false;
                                uint _e218 = tx;
                                if ((_e218 <= high_tile.x)) {
                                } else {
                                    break;
                                }
                                {
                                    uint _e222 = ty;
                                    uint _e225 = tx;
                                    float behind_2 = _group_1_binding_5_cs[((fine + (_e222 * across)) + _e225)];
                                    if ((behind_2 <= bound)) {
                                        uint _e230 = tx;
                                        uint _e231 = ty;
                                        uvec2 tile = (uvec2(_e230, _e231) << uvec2(2u));
                                        uvec2 c = (max(tile, a_1) - row);
                                        uvec2 d = (min((tile + uvec2(3u)), b_1) - row);
                                        float _e243 = bound_through(v_9, _e131, p_2, size_1, c, d);
                                        if ((behind_2 <= _e243)) {
                                            return false;
                                        }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
    return true;
}

uint outcome(View v_10, uint index, bool against_depths) {
    bool local_9 = false;
    bool local_10 = false;
    Chunk _e5 = _group_1_binding_3_cs[index];
    Projected _e6 = project(v_10, _e5);
    if (_e6.outside) {
        return OUTSIDE;
    }
    if (against_depths) {
        local_9 = (_e6.nearest > 0.0);
    } else {
        local_9 = false;
    }
    bool _e15 = local_9;
    if (_e15) {
        bool _e18 = is_hidden(v_10, _e6);
        local_10 = _e18;
    } else {
        local_10 = false;
    }
    bool _e20 = local_10;
    if (_e20) {
        return HIDDEN;
    }
    return VISIBLE;
}

bool is_chosen(uint place) {
    uint _e5 = atomicOr(chosen[(place / 32u)], 0u);
    return (((_e5 >> (place % 32u)) & 1u) != 0u);
}

uint end_of_run(uint place_1) {
    uint first_1 = 0u;
    uint w = 0u;
    first_1 = (place_1 % 32u);
    w = (place_1 / 32u);
    bool loop_init_7 = true;
    while(true) {
        if (!loop_init_7) {
            uint _e28 = w;
            w = (_e28 + 1u);
        }
        loop_init_7 = false;
        uint _e7 = w;
        if ((_e7 < WORDS)) {
        } else {
            break;
        }
        {
            uint _e11 = w;
            uint _e13 = atomicOr(chosen[_e11], 0u);
            uint _e16 = first_1;
            uint without = (~(_e13) & (4294967295u << _e16));
            if ((without != 0u)) {
                uint _e21 = w;
                return ((_e21 * 32u) + uint(findLSB(without)));
            }
            first_1 = 0u;
        }
    }
    return GROUP;
}

void list(uint local_11, View v_11, bool only_seen, bool against_depths_1) {
    uint count = 0u;
    uint start = 0u;
    uint found = 0u;
    bool local_12 = false;
    uint before = 0u;
    uint carry = 0u;
    uint w_1 = 0u;
    bool local_13 = false;
    uint face = ((v_11.layer * 5u) + v_11.face);
    if ((local_11 < 4u)) {
        atomicExchange(sums[local_11], 0u);
    }
    bool loop_init_8 = true;
    while(true) {
        if (!loop_init_8) {
            uint _e208 = start;
            start = (_e208 + GROUP);
        }
        loop_init_8 = false;
        uint _e18 = start;
        uint _e21 = _group_1_binding_1_cs.chunk_count;
        if ((_e18 < _e21)) {
        } else {
            break;
        }
        {
            if ((local_11 < WORDS)) {
                atomicExchange(chosen[local_11], 0u);
            }
            memoryBarrierShared();
            barrier();
            uint _e28 = start;
            uint index_1 = (_e28 + local_11);
            found = OUTSIDE;
            uint _e34 = _group_1_binding_1_cs.chunk_count;
            if ((index_1 < _e34)) {
                if (!(!(only_seen))) {
                    uint _e42 = _group_1_binding_8_cs[index_1];
                    uint _e45 = _group_1_binding_1_cs.looks_back;
                    local_12 = ((_e42 + _e45) >= v_11.stamp);
                } else {
                    local_12 = true;
                }
                bool _e50 = local_12;
                if (_e50) {
                    uint _e51 = outcome(v_11, index_1, against_depths_1);
                    found = _e51;
                }
                if (!(only_seen)) {
                    uint _e56 = _group_1_binding_1_cs.chunk_count;
                    uint _e60 = found;
                    _group_1_binding_9_cs[((face * _e56) + index_1)] = uint((_e60 == VISIBLE));
                    uint _e64 = found;
                    if ((_e64 == OUTSIDE)) {
                        uint _e70 = atomicAdd(sums[0], 1u);
                    } else {
                        uint _e71 = found;
                        if ((_e71 == HIDDEN)) {
                            uint _e77 = atomicAdd(sums[1], 1u);
                        }
                    }
                }
                uint _e78 = found;
                if ((_e78 == VISIBLE)) {
                    uint _e89 = atomicOr(chosen[(local_11 / 32u)], (1u << (local_11 % 32u)));
                }
            }
            memoryBarrierShared();
            barrier();
            uint _e90 = count;
            before = _e90;
            carry = 0u;
            w_1 = 0u;
            bool loop_init_9 = true;
            while(true) {
                if (!loop_init_9) {
                    uint _e135 = w_1;
                    w_1 = (_e135 + 1u);
                }
                loop_init_9 = false;
                uint _e96 = w_1;
                if ((_e96 < WORDS)) {
                } else {
                    break;
                }
                {
                    uint _e100 = w_1;
                    uint word = atomicOr(chosen[_e100], 0u);
                    uint _e105 = carry;
                    uint begins = (word & ~(((word << 1u) | _e105)));
                    carry = (word >> 31u);
                    uint all_ = uint(bitCount(begins));
                    uint _e112 = w_1;
                    if ((_e112 < (local_11 / 32u))) {
                        uint _e116 = before;
                        before = (_e116 + all_);
                    } else {
                        uint _e118 = w_1;
                        if ((_e118 == (local_11 / 32u))) {
                            uint _e122 = before;
                            before = (_e122 + uint(bitCount((begins & ((1u << (local_11 % 32u)) - 1u)))));
                        }
                    }
                    uint _e132 = count;
                    count = (_e132 + all_);
                }
            }
            uint _e137 = found;
            if ((_e137 == VISIBLE)) {
                if (!((local_11 == 0u))) {
                    bool _e147 = is_chosen((local_11 - 1u));
                    local_13 = !(_e147);
                } else {
                    local_13 = true;
                }
                bool _e150 = local_13;
                if (_e150) {
                    uint _e151 = start;
                    uint _e152 = end_of_run(local_11);
                    uint last_2 = ((_e151 + _e152) - 1u);
                    uint first_index = _group_1_binding_3_cs[index_1].first_index;
                    uint _e162 = _group_1_binding_1_cs.chunk_count;
                    uint _e164 = before;
                    uint at = (((face * _e162) + _e164) * 5u);
                    uint _e173 = _group_1_binding_3_cs[last_2].first_index;
                    uint _e177 = _group_1_binding_3_cs[last_2].index_count;
                    _group_1_binding_6_cs[at] = ((_e173 + _e177) - first_index);
                    _group_1_binding_6_cs[(at + 1u)] = 1u;
                    _group_1_binding_6_cs[(at + 2u)] = first_index;
                    _group_1_binding_6_cs[(at + 3u)] = 0u;
                    _group_1_binding_6_cs[(at + 4u)] = 0u;
                }
                uint _e204 = _group_1_binding_3_cs[index_1].index_count;
                uint _e207 = atomicAdd(sums[2], (_e204 / 3u));
            }
            memoryBarrierShared();
            barrier();
        }
    }
    if ((local_11 == 0u)) {
        uint _e215 = count;
        _group_1_binding_7_cs[face] = _e215;
        uint tally = (v_11.layer * 8u);
        if (only_seen) {
            uint _e225 = atomicOr(sums[2], 0u);
            uint _e226 = atomicAdd(_group_1_binding_10_cs[(tally + 7u)], _e225);
            return;
        } else {
            uint _e233 = _group_1_binding_1_cs.chunk_count;
            uint _e234 = atomicAdd(_group_1_binding_10_cs[(tally + 3u)], _e233);
            uint _e241 = atomicOr(sums[0], 0u);
            uint _e242 = atomicAdd(_group_1_binding_10_cs[(tally + 4u)], _e241);
            uint _e249 = atomicOr(sums[1], 0u);
            uint _e250 = atomicAdd(_group_1_binding_10_cs[(tally + 5u)], _e249);
            uint _e257 = atomicOr(sums[2], 0u);
            uint _e258 = atomicAdd(_group_1_binding_10_cs[(tally + 6u)], _e257);
            return;
        }
    } else {
        return;
    }
}

void main() {
    uint local = gl_LocalInvocationIndex;
    uvec3 group = gl_WorkGroupID;
    uint _e5 = _group_0_binding_0_cs.slot;
    View _e13 = _group_1_binding_2_cs[(((_e5 + group.y) * 5u) + group.x)];
    list(local, _e13, true, false);
    return;
}

