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
struct Axes {
    vec3 right;
    vec3 up;
    vec3 forward;
    bool is_top;
};
struct Outline {
    vec3 corners[3];
    vec3 sides[3];
    float volume;
};
struct Ready {
    vec4 sides[3];
    vec4 plane;
    float least;
    float greatest;
    uint id;
    float low;
    float high;
    uvec4 box;
};
struct Tile {
    vec4 ends;
    uvec2 first;
    Axes axes;
};
const uint GROUP = 64u;
const uint STRIPS = 2u;
const uint HIGH = 16u;
const uint RUNS = 256u;
const uint LIST = 128u;
const uint OF_A_RUN = 32u;
const uint NOBODY = 4294967295u;
const float NEAREST = 3e38;
const uint PIXELS = 512u;
const uint FEW = 32u;

layout(std140, binding = 0) uniform View_block_0Compute { View _group_0_binding_0_cs; };

layout(std140, binding = 1) uniform Settings_block_1Compute { Settings _group_1_binding_1_cs; };

layout(std430, binding = 2) readonly buffer type_6_block_2Compute { View _group_1_binding_2_cs[]; };

layout(std430, binding = 3) readonly buffer type_9_block_3Compute { Chunk _group_1_binding_3_cs[]; };

layout(std430, binding = 12) readonly buffer type_10_block_4Compute { uint _group_1_binding_12_cs[]; };

layout(std430, binding = 13) buffer type_12_block_5Compute { uint _group_1_binding_13_cs[]; };

layout(std430, binding = 14) buffer type_12_block_6Compute { uint _group_1_binding_14_cs[]; };

layout(std430, binding = 15) readonly buffer type_13_block_7Compute { Vertex _group_1_binding_15_cs[]; };

layout(std430, binding = 16) readonly buffer type_10_block_8Compute { uint _group_1_binding_16_cs[]; };

vec4 depths[2] = vec4[2](vec4(0.0), vec4(0.0));

uvec4 ids[2] = uvec4[2](uvec4(0u), uvec4(0u));

shared uint numbers[384];

shared float bounds[384];

shared uint sorted[384];

shared uint listed;

shared uvec2 listed_now;

shared uint chosen;

shared Ready ready[64];

shared uint ready_count;

shared uint farthest;

shared uint small_depths[512];

shared uint small_ids[512];


vec3 relative(View v, vec3 high, vec3 low) {
    return ((high - v.eye_high) + (low - v.eye_low));
}

vec3 in_frame(View v_1, vec3 r) {
    float x_4 = (((v_1.tangent.x * r.x) + (v_1.tangent.y * r.y)) + (v_1.tangent.z * r.z));
    float y_4 = (((v_1.bitangent.x * r.x) + (v_1.bitangent.y * r.y)) + (v_1.bitangent.z * r.z));
    float z = (((v_1.normal.x * r.x) + (v_1.normal.y * r.y)) + (v_1.normal.z * r.z));
    float snap = (v_1.tolerance + ((abs(x_4) + abs(y_4)) * 9.536743e-7));
    return vec3(x_4, y_4, ((abs(z) <= snap) ? 0.0 : z));
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
    float height_1 = (((normal.x * _e4.x) + (normal.y * _e4.y)) + (normal.z * _e4.z));
    vec3 n_3 = vec3((((v_4.tangent.x * normal.x) + (v_4.tangent.y * normal.y)) + (v_4.tangent.z * normal.z)), (((v_4.bitangent.x * normal.x) + (v_4.bitangent.y * normal.y)) + (v_4.bitangent.z * normal.z)), (((v_4.normal.x * normal.x) + (v_4.normal.y * normal.y)) + (v_4.normal.z * normal.z)));
    vec3 _e59 = on_face(v_4, n_3);
    vec3 q = vec3(_e59.x, ((v_4.upside_down == 1u) ? -(_e59.y) : _e59.y), _e59.z);
    float up = (0.25 * (q.y + q.z));
    vec3 coefficients = ((v_4.face == 0u) ? q : vec3(q.x, up, (up + q.z)));
    float error = ((((abs(_e4.x) + abs(_e4.y)) + abs(_e4.z)) * 2.3841858e-7) / abs(height_1));
    return vec4((coefficients * (v_4.near / height_1)), error);
}

float depth_of(View v_5, vec4 plane, vec4 position) {
    uint _e8 = _group_1_binding_1_cs.resolution;
    float x_5 = (((2.0 * position.x) / float(_e8)) - 1.0);
    float y_5 = (((2.0 * (position.y - float(v_5.first_row))) / float(v_5.rows)) - 1.0);
    float depth_1 = min(fma(plane.x, x_5, fma(plane.y, y_5, plane.z)), 1.0);
    return ((abs((depth_1 - position.z)) <= (0.0625 * position.z)) ? depth_1 : position.z);
}

float behind(vec4 plane_1, float depth) {
    return (depth * (0.9999981 - min(plane_1.w, 0.0009765625)));
}

float dot_fused(vec3 a, vec3 b) {
    return fma(a.x, b.x, fma(a.y, b.y, (a.z * b.z)));
}

vec3 cross_fused(vec3 a_1, vec3 b_1) {
    return vec3(fma(a_1.y, b_1.z, -((a_1.z * b_1.y))), fma(a_1.z, b_1.x, -((a_1.x * b_1.z))), fma(a_1.x, b_1.y, -((a_1.y * b_1.x))));
}

vec3 high_of(Vertex c) {
    return vec3(c.high_x, c.high_y, c.high_z);
}

vec3 low_of(Vertex c_1) {
    return vec3(c_1.low_x, c_1.low_y, c_1.low_z);
}

float side_of(vec3 edge, vec3 direction) {
    float _e2 = dot_fused(edge, direction);
    float first_2 = ((edge.x != 0.0) ? edge.x : ((edge.y != 0.0) ? edge.y : edge.z));
    return ((_e2 == 0.0) ? first_2 : _e2);
}

Axes axes_of(View v_6) {
    bool is_top = (v_6.face == 0u);
    vec3 up_1 = (is_top ? v_6.clip_y : (0.5 * (v_6.clip_y + v_6.clip_w)));
    return Axes((((v_6.clip_x.x * v_6.tangent) + (v_6.clip_x.y * v_6.bitangent)) + (v_6.clip_x.z * v_6.normal)), (((up_1.x * v_6.tangent) + (up_1.y * v_6.bitangent)) + (up_1.z * v_6.normal)), (((v_6.clip_w.x * v_6.tangent) + (v_6.clip_w.y * v_6.bitangent)) + (v_6.clip_w.z * v_6.normal)), is_top);
}

vec3 along(Axes a_2, vec3 d) {
    float _e3 = dot_fused(a_2.right, d);
    float _e5 = dot_fused(a_2.up, d);
    float _e7 = dot_fused(a_2.forward, d);
    return vec3(_e3, _e5, _e7);
}

float height_of(Axes a_3, vec3 p_1) {
    return (a_3.is_top ? p_1.z : p_1.y);
}

vec3 with_height(Axes a_4, vec3 p_2, float height) {
    return (a_4.is_top ? vec3(p_2.xy, height) : vec3(p_2.x, height, p_2.z));
}

vec3 corner_on(View v_7, Axes a_5, Vertex c_2) {
    vec3 _e3 = high_of(c_2);
    vec3 _e6 = low_of(c_2);
    vec3 _e10 = along(a_5, ((_e3 - v_7.eye_high) + (_e6 - v_7.eye_low)));
    float _e11 = height_of(a_5, _e10);
    float snap_1 = fma((abs(_e10.x) + abs((a_5.is_top ? _e10.y : _e10.z))), 9.536743e-7, v_7.tolerance);
    vec3 _e27 = with_height(a_5, _e10, ((abs(_e11) <= snap_1) ? 0.0 : _e11));
    return _e27;
}

vec3 side_on(Axes a_6, Vertex c_3, Vertex d_1, vec3 from_place, vec3 to_place) {
    bool local_2 = false;
    vec3 _e5 = high_of(d_1);
    vec3 _e6 = high_of(c_3);
    vec3 _e8 = low_of(d_1);
    vec3 _e9 = low_of(c_3);
    vec3 _e12 = along(a_6, ((_e5 - _e6) + (_e8 - _e9)));
    float _e13 = height_of(a_6, from_place);
    float _e14 = height_of(a_6, to_place);
    float _e15 = height_of(a_6, _e12);
    if (!((_e13 == 0.0))) {
        local_2 = (_e14 == 0.0);
    } else {
        local_2 = true;
    }
    bool _e25 = local_2;
    vec3 _e27 = with_height(a_6, _e12, (_e25 ? (_e14 - _e13) : _e15));
    return _e27;
}

Outline outline(View v_8, Axes axes, Vertex a_7, Vertex b_2, Vertex c_4) {
    vec3 _e5 = corner_on(v_8, axes, a_7);
    vec3 _e6 = corner_on(v_8, axes, b_2);
    vec3 _e7 = corner_on(v_8, axes, c_4);
    vec3 _e8 = side_on(axes, a_7, b_2, _e5, _e6);
    vec3 _e9 = side_on(axes, b_2, c_4, _e6, _e7);
    vec3 _e10 = side_on(axes, c_4, a_7, _e7, _e5);
    vec3 _e11 = cross_fused(_e8, _e9);
    float _e12 = dot_fused(_e11, _e5);
    float turn = ((_e12 > 0.0) ? 1.0 : -1.0);
    vec3 _e19 = cross_fused((_e5 + _e6), _e8);
    vec3 _e22 = cross_fused((_e6 + _e7), _e9);
    vec3 _e25 = cross_fused((_e7 + _e5), _e10);
    vec3 sides[3] = vec3[3]((turn * _e19), (turn * _e22), (turn * _e25));
    return Outline(vec3[3](_e5, _e6, _e7), sides, _e12);
}

Tile tile_of(View v_9, uvec2 group) {
    uint n_4 = _group_1_binding_1_cs.resolution;
    uvec2 first_3 = (group * uvec2(32u, 16u));
    uvec2 last = min((first_3 + uvec2(31u, 15u)), (uvec2(n_4, v_9.rows) - uvec2(1u)));
    ivec2 shift = ivec2(uvec2(n_4, ((v_9.face == 0u) ? n_4 : 0u)));
    vec2 a_8 = vec2((ivec2(((2u * first_3) + uvec2(1u))) - shift));
    vec2 b_3 = vec2((ivec2(((2u * last) + uvec2(1u))) - shift));
    Axes _e43 = axes_of(v_9);
    return Tile(vec4(a_8, b_3), first_3, _e43);
}

float bound_of(View v_10, Tile tile, Chunk chunk) {
    bool local_3 = false;
    uint _e5 = _group_1_binding_1_cs.resolution;
    float n_5 = float(_e5);
    Axes axes_1 = tile.axes;
    vec3 _e15 = along(axes_1, ((chunk.center_high - v_10.eye_high) + (chunk.center_low - v_10.eye_low)));
    vec3 h = chunk.half_sides;
    vec3 a_9 = (h.x * vec3(axes_1.right.x, axes_1.up.x, axes_1.forward.x));
    vec3 b_4 = (h.y * vec3(axes_1.right.y, axes_1.up.y, axes_1.forward.y));
    vec3 d_2 = (h.z * vec3(axes_1.right.z, axes_1.up.z, axes_1.forward.z));
    float margin = (v_10.tolerance + (4e-6 * (((((abs(_e15.x) + abs(_e15.y)) + abs(_e15.z)) + h.x) + h.y) + h.z)));
    vec4 left = vec4(((n_5 * _e15.xy) - (tile.ends.xy * _e15.z)), ((tile.ends.zw * _e15.z) - (n_5 * _e15.xy)));
    vec4 reach = ((abs(vec4(((n_5 * a_9.xy) - (tile.ends.xy * a_9.z)), ((tile.ends.zw * a_9.z) - (n_5 * a_9.xy)))) + abs(vec4(((n_5 * b_4.xy) - (tile.ends.xy * b_4.z)), ((tile.ends.zw * b_4.z) - (n_5 * b_4.xy))))) + abs(vec4(((n_5 * d_2.xy) - (tile.ends.xy * d_2.z)), ((tile.ends.zw * d_2.z) - (n_5 * d_2.xy)))));
    float deep = (((abs(a_9.z) + abs(b_4.z)) + abs(d_2.z)) + margin);
    if (!(any(lessThan((left + reach), vec4(((-2.0 * n_5) * margin)))))) {
        local_3 = ((_e15.z + deep) < 0.0);
    } else {
        local_3 = true;
    }
    bool _e151 = local_3;
    if (_e151) {
        return -1.0;
    }
    float nearest = (_e15.z - deep);
    return ((nearest > margin) ? ((v_10.near / nearest) * 1.00001) : NEAREST);
}

void add_to_list(uint base, uint number_2, float bound) {
    uint _e4 = atomicOr(farthest, 0u);
    if ((bound >= uintBitsToFloat(_e4))) {
        uint _e9 = atomicAdd(listed, 1u);
        uint at_1 = (base + _e9);
        numbers[at_1] = number_2;
        bounds[at_1] = bound;
        return;
    } else {
        return;
    }
}

void sort(uint local_4, uint base_1, uint count) {
    uint i = 0u;
    uint rank = 0u;
    uint k = 0u;
    bool local_5 = false;
    bool local_6 = false;
    i = (base_1 + local_4);
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e49 = i;
            i = (_e49 + GROUP);
        }
        loop_init = false;
        uint _e5 = i;
        if ((_e5 < (base_1 + count))) {
        } else {
            break;
        }
        {
            uint _e9 = i;
            float mine_1 = bounds[_e9];
            rank = base_1;
            k = base_1;
            bool loop_init_1 = true;
            while(true) {
                if (!loop_init_1) {
                    uint _e43 = k;
                    k = (_e43 + 1u);
                }
                loop_init_1 = false;
                uint _e14 = k;
                if ((_e14 < (base_1 + count))) {
                } else {
                    break;
                }
                {
                    uint _e17 = rank;
                    uint _e19 = k;
                    float _e21 = bounds[_e19];
                    if (!((_e21 > mine_1))) {
                        uint _e27 = k;
                        float _e29 = bounds[_e27];
                        if ((_e29 == mine_1)) {
                            uint _e33 = k;
                            uint _e34 = i;
                            local_6 = (_e33 < _e34);
                        } else {
                            local_6 = false;
                        }
                        bool _e37 = local_6;
                        local_5 = _e37;
                    } else {
                        local_5 = true;
                    }
                    bool _e39 = local_5;
                    rank = (_e17 + uint(_e39));
                }
            }
            uint _e46 = rank;
            uint _e48 = i;
            sorted[_e46] = _e48;
        }
    }
    memoryBarrierShared();
    barrier();
    return;
}

uvec2 list_runs(uint local_7, View v_11, Tile tile_1, uint from_number) {
    uint first = 0u;
    uint count_1 = 0u;
    bool local_8 = false;
    if ((local_7 == 0u)) {
        atomicExchange(listed, 0u);
    }
    memoryBarrierShared();
    barrier();
    first = from_number;
    while(true) {
        uint _e11 = first;
        uint number_5 = (_e11 + local_7);
        uint _e15 = _group_1_binding_1_cs.run_count;
        if ((number_5 < _e15)) {
            uint _e21 = _group_1_binding_1_cs.chunk_count;
            Chunk _e24 = _group_1_binding_3_cs[(_e21 + number_5)];
            float _e25 = bound_of(v_11, tile_1, _e24);
            add_to_list(0u, number_5, _e25);
        }
        uint _e26 = first;
        first = (_e26 + GROUP);
        memoryBarrierShared();
        barrier();
        if ((local_7 == 0u)) {
            uint _e33 = atomicOr(listed, 0u);
            listed_now = uvec2(_e33, 0u);
        }
        memoryBarrierShared();
        barrier();
        uvec2 _e37 = listed_now;
        memoryBarrierShared();
        barrier();
        count_1 = _e37.x;
        uint _e39 = count_1;
        if (!((_e39 > 192u))) {
            uint _e45 = first;
            uint _e48 = _group_1_binding_1_cs.run_count;
            local_8 = (_e45 >= _e48);
        } else {
            local_8 = true;
        }
        bool _e51 = local_8;
        if (_e51) {
            break;
        }
    }
    uint _e53 = count_1;
    sort(local_7, 0u, _e53);
    uint _e54 = first;
    uint _e55 = count_1;
    return uvec2(_e54, _e55);
}

bool may_be_seen(uint place, uint runs) {
    bool local_9 = false;
    if ((place < runs)) {
        uint _e8 = sorted[place];
        float _e10 = bounds[_e8];
        uint _e12 = atomicOr(farthest, 0u);
        local_9 = (_e10 >= uintBitsToFloat(_e12));
    } else {
        local_9 = false;
    }
    bool _e16 = local_9;
    return _e16;
}

uvec3 list_chunks(uint local_10, View v_12, Tile tile_2, uint from_place_1, uint runs_1) {
    uint place_1 = 0u;
    uvec2 now = uvec2(0u);
    bool local_11 = false;
    if ((local_10 == 0u)) {
        atomicExchange(listed, 0u);
    }
    memoryBarrierShared();
    barrier();
    place_1 = from_place_1;
    while(true) {
        uint _e13 = place_1;
        uint mine_2 = (_e13 + (local_10 / OF_A_RUN));
        bool _e17 = may_be_seen(mine_2, runs_1);
        if (_e17) {
            uint _e21 = _group_1_binding_1_cs.chunk_count;
            uint _e25 = sorted[mine_2];
            uint _e27 = numbers[_e25];
            Chunk run = _group_1_binding_3_cs[(_e21 + _e27)];
            if (((local_10 % OF_A_RUN) < run.index_count)) {
                uint number_6 = (run.first_index + (local_10 % OF_A_RUN));
                Chunk _e42 = _group_1_binding_3_cs[number_6];
                float _e43 = bound_of(v_12, tile_2, _e42);
                add_to_list(RUNS, number_6, _e43);
            }
        }
        uint _e44 = place_1;
        place_1 = (_e44 + 2u);
        memoryBarrierShared();
        barrier();
        if ((local_10 == 0u)) {
            uint _e51 = atomicOr(listed, 0u);
            uint _e52 = place_1;
            bool _e53 = may_be_seen(_e52, runs_1);
            listed_now = uvec2(_e51, uint(_e53));
        }
        memoryBarrierShared();
        barrier();
        uvec2 _e57 = listed_now;
        memoryBarrierShared();
        barrier();
        now = _e57;
        uint _e59 = now.x;
        if (!((_e59 > 64u))) {
            uint _e66 = now.y;
            local_11 = (_e66 == 0u);
        } else {
            local_11 = true;
        }
        bool _e70 = local_11;
        if (_e70) {
            break;
        }
    }
    uint _e73 = now.x;
    sort(local_10, RUNS, _e73);
    uint _e74 = place_1;
    uvec2 _e75 = now;
    return uvec3(_e74, _e75);
}

bool points_at_the_eye(Outline t) {
    bool found = false;
    uint k_1 = 0u;
    bool local_12 = false;
    bool loop_init_2 = true;
    while(true) {
        if (!loop_init_2) {
            uint _e42 = k_1;
            k_1 = (_e42 + 1u);
        }
        loop_init_2 = false;
        uint _e5 = k_1;
        if ((_e5 < 3u)) {
        } else {
            break;
        }
        {
            uint _e9 = k_1;
            vec3 p_3 = t.corners[_e9];
            uint _e12 = k_1;
            vec3 q_1 = t.corners[((_e12 + 1u) % 3u)];
            float most = ((0.001 * dot((p_3 + q_1), (p_3 + q_1))) * dot((q_1 - p_3), (q_1 - p_3)));
            bool _e27 = found;
            if (!(_e27)) {
                uint _e32 = k_1;
                uint _e35 = k_1;
                local_12 = (dot(t.sides[_e32], t.sides[_e35]) <= most);
            } else {
                local_12 = true;
            }
            bool _e40 = local_12;
            found = _e40;
        }
    }
    bool _e44 = found;
    return _e44;
}

vec3 greatest_in(Tile tile_3, vec3 along_1, float n) {
    return vec3(mix(tile_3.ends.xy, tile_3.ends.zw, greaterThan(along_1.xy, vec2(0.0))), n);
}

Ready prepare(View v_13, Tile tile_4, uint number_3) {
    Ready found_1 = Ready(vec4[3](vec4(0.0), vec4(0.0), vec4(0.0)), vec4(0.0), 0.0, 0.0, 0u, 0.0, 0.0, uvec4(0u));
    bool local_13 = false;
    bool local_14 = false;
    bool local_15 = false;
    uvec4 box = uvec4(0u, 0u, 32u, 16u);
    bool local_16 = false;
    uint k_2 = 0u;
    found_1.box = uvec4(0u);
    uint _e9 = _group_1_binding_1_cs.resolution;
    float n_6 = float(_e9);
    uint _e16 = _group_1_binding_16_cs[(3u * number_3)];
    Vertex a_10 = _group_1_binding_15_cs[_e16];
    if (!((a_10.front == v_13.emitter))) {
        local_13 = (a_10.back == v_13.emitter);
    } else {
        local_13 = true;
    }
    bool _e29 = local_13;
    if (_e29) {
        Ready _e30 = found_1;
        return _e30;
    }
    uint _e38 = _group_1_binding_16_cs[((3u * number_3) + 1u)];
    Vertex b_5 = _group_1_binding_15_cs[_e38];
    uint _e48 = _group_1_binding_16_cs[((3u * number_3) + 2u)];
    Vertex c_5 = _group_1_binding_15_cs[_e48];
    Outline _e52 = outline(v_13, tile_4.axes, a_10, b_5, c_5);
    vec3 p_4 = _e52.corners[0];
    vec3 q_2 = _e52.corners[1];
    vec3 r_1 = _e52.corners[2];
    float slack = (-1e-5 * n_6);
    vec4 all_ = max(max(vec4(((n_6 * p_4.xy) - (tile_4.ends.xy * p_4.z)), ((tile_4.ends.zw * p_4.z) - (n_6 * p_4.xy))), vec4(((n_6 * q_2.xy) - (tile_4.ends.xy * q_2.z)), ((tile_4.ends.zw * q_2.z) - (n_6 * q_2.xy)))), vec4(((n_6 * r_1.xy) - (tile_4.ends.xy * r_1.z)), ((tile_4.ends.zw * r_1.z) - (n_6 * r_1.xy))));
    vec3 extent = max(max(abs(p_4), abs(q_2)), abs(r_1));
    float deepest = max(max(p_4.z, q_2.z), r_1.z);
    bool is_beyond = any(lessThan(all_, vec4((slack * ((extent.x + extent.y) + extent.z)))));
    if (!(is_beyond)) {
        local_14 = (deepest <= 0.0);
    } else {
        local_14 = true;
    }
    bool _e133 = local_14;
    if (!(_e133)) {
        local_15 = (_e52.volume == 0.0);
    } else {
        local_15 = true;
    }
    bool _e141 = local_15;
    if (_e141) {
        Ready _e142 = found_1;
        return _e142;
    }
    found_1.low = -3e38;
    found_1.high = NEAREST;
    float shallowest = min(min(p_4.z, q_2.z), r_1.z);
    if ((shallowest > 0.0)) {
        bool _e162 = points_at_the_eye(_e52);
        local_16 = !(_e162);
    } else {
        local_16 = false;
    }
    bool _e165 = local_16;
    if (_e165) {
        float margin_1 = ((n_6 * ((8e-6 * ((extent.x + extent.y) + extent.z)) + v_13.tolerance)) / shallowest);
        vec2 a_on = (p_4.xy * (n_6 / p_4.z));
        vec2 b_on = (q_2.xy * (n_6 / q_2.z));
        vec2 c_on = (r_1.xy * (n_6 / r_1.z));
        vec2 low_3 = (min(min(a_on, b_on), c_on) - vec2(margin_1));
        vec2 high_3 = (max(max(a_on, b_on), c_on) + vec2(margin_1));
        vec2 first_4 = ceil(max((0.5 * (low_3 - tile_4.ends.xy)), vec2(0.0)));
        vec2 last_1 = floor((0.5 * (min(high_3, tile_4.ends.zw) - tile_4.ends.xy)));
        if (any(greaterThan(first_4, last_1))) {
            Ready _e217 = found_1;
            return _e217;
        }
        found_1.low = low_3.y;
        found_1.high = high_3.y;
        box = uvec4(uvec2(first_4), (uvec2((last_1 - first_4)) + uvec2(1u)));
    }
    bool loop_init_3 = true;
    while(true) {
        if (!loop_init_3) {
            uint _e255 = k_2;
            k_2 = (_e255 + 1u);
        }
        loop_init_3 = false;
        uint _e231 = k_2;
        if ((_e231 < 3u)) {
        } else {
            break;
        }
        {
            uint _e235 = k_2;
            vec3 side_1 = _e52.sides[_e235];
            uint _e238 = k_2;
            float _e242 = side_of(side_1, vec3(0.0));
            found_1.sides[_e238] = vec4(side_1, ((_e242 > 0.0) ? 1.0 : 0.0));
            vec3 _e249 = greatest_in(tile_4, side_1, n_6);
            float _e250 = dot_fused(side_1, _e249);
            if ((_e250 < 0.0)) {
                Ready _e253 = found_1;
                return _e253;
            }
        }
    }
    found_1.id = ((_e52.volume > 0.0) ? a_10.back : a_10.front);
    vec3 normal_1 = vec3(a_10.normal_x, a_10.normal_y, a_10.normal_z);
    vec3 _e268 = high_of(a_10);
    vec3 _e269 = low_of(a_10);
    vec3 _e270 = relative(v_13, _e268, _e269);
    float height_2 = (((normal_1.x * _e270.x) + (normal_1.y * _e270.y)) + (normal_1.z * _e270.z));
    float scale = ((height_2 == 0.0) ? 0.0 : (v_13.near / (height_2 * n_6)));
    float error_1 = ((((abs(_e270.x) + abs(_e270.y)) + abs(_e270.z)) * 2.3841858e-7) / abs(height_2));
    float _e303 = behind(vec4(error_1), 1.0);
    uint _e305 = found_1.id;
    uint _e308 = _group_1_binding_1_cs.patch_count;
    float factor = ((_e305 == _e308) ? _e303 : 1.0);
    vec3 _e314 = along(tile_4.axes, normal_1);
    found_1.plane = vec4((scale * _e314), factor);
    found_1.least = ((v_13.near / deepest) * 0.999999);
    found_1.greatest = ((shallowest > 0.0) ? min(((v_13.near / shallowest) * 1.000001), 1.0) : 1.0);
    vec4 _e334 = found_1.plane;
    vec4 _e337 = found_1.plane;
    vec3 _e339 = greatest_in(tile_4, _e337.xyz, n_6);
    float _e340 = dot_fused(_e334.xyz, _e339);
    float _e342 = found_1.least;
    float _e344 = found_1.greatest;
    uint _e348 = atomicOr(farthest, 0u);
    if (((clamp(_e340, _e342, _e344) * factor) >= uintBitsToFloat(_e348))) {
        uvec4 _e352 = box;
        found_1.box = _e352;
    }
    Ready _e353 = found_1;
    return _e353;
}

bvec4 is_inside(vec4 side, vec4 x, float y, float n_1) {
    vec4 product = fma(vec4(side.x), x, vec4(fma(side.y, y, (side.z * n_1))));
    return bvec4(greaterThan(product, vec4(0.0)).x || bvec4(equal(product, vec4(0.0)).x && bvec4((side.w != 0.0)).x, equal(product, vec4(0.0)).y && bvec4((side.w != 0.0)).y, equal(product, vec4(0.0)).z && bvec4((side.w != 0.0)).z, equal(product, vec4(0.0)).w && bvec4((side.w != 0.0)).w).x, greaterThan(product, vec4(0.0)).y || bvec4(equal(product, vec4(0.0)).x && bvec4((side.w != 0.0)).x, equal(product, vec4(0.0)).y && bvec4((side.w != 0.0)).y, equal(product, vec4(0.0)).z && bvec4((side.w != 0.0)).z, equal(product, vec4(0.0)).w && bvec4((side.w != 0.0)).w).y, greaterThan(product, vec4(0.0)).z || bvec4(equal(product, vec4(0.0)).x && bvec4((side.w != 0.0)).x, equal(product, vec4(0.0)).y && bvec4((side.w != 0.0)).y, equal(product, vec4(0.0)).z && bvec4((side.w != 0.0)).z, equal(product, vec4(0.0)).w && bvec4((side.w != 0.0)).w).z, greaterThan(product, vec4(0.0)).w || bvec4(equal(product, vec4(0.0)).x && bvec4((side.w != 0.0)).x, equal(product, vec4(0.0)).y && bvec4((side.w != 0.0)).y, equal(product, vec4(0.0)).z && bvec4((side.w != 0.0)).z, equal(product, vec4(0.0)).w && bvec4((side.w != 0.0)).w).w);
}

vec4 depth_at(Ready t_1, vec4 x_1, float y_1, float n_2) {
    vec4 plane_2 = fma(vec4(t_1.plane.x), x_1, vec4(fma(t_1.plane.y, y_1, (t_1.plane.z * n_2))));
    return (clamp(plane_2, vec4(t_1.least), vec4(t_1.greatest)) * t_1.plane.w);
}

void draw_small(Tile tile_5, Ready t_2, bool ids_now) {
    uint i_1 = 0u;
    bool local_17 = false;
    bool local_18 = false;
    uint _e5 = _group_1_binding_1_cs.resolution;
    float n_7 = float(_e5);
    bool loop_init_4 = true;
    while(true) {
        if (!loop_init_4) {
            uint _e85 = i_1;
            i_1 = (_e85 + 1u);
        }
        loop_init_4 = false;
        uint _e9 = i_1;
        if ((_e9 < (t_2.box.z * t_2.box.w))) {
        } else {
            break;
        }
        {
            uint _e18 = i_1;
            uint _e22 = i_1;
            uvec2 at_2 = (t_2.box.xy + uvec2((_e18 % t_2.box.z), (_e22 / t_2.box.z)));
            vec2 direction_1 = (tile_5.ends.xy + (2.0 * vec2(at_2)));
            vec4 x_6 = vec4(direction_1.x);
            bvec4 _e39 = is_inside(t_2.sides[0], x_6, direction_1.y, n_7);
            if (_e39.x) {
                bvec4 _e46 = is_inside(t_2.sides[1], x_6, direction_1.y, n_7);
                local_17 = _e46.x;
            } else {
                local_17 = false;
            }
            bool _e49 = local_17;
            if (_e49) {
                bvec4 _e55 = is_inside(t_2.sides[2], x_6, direction_1.y, n_7);
                local_18 = _e55.x;
            } else {
                local_18 = false;
            }
            bool inside = local_18;
            if (!(inside)) {
                continue;
            }
            vec4 _e61 = depth_at(t_2, x_6, direction_1.y, n_7);
            uint bits = floatBitsToUint(_e61.x);
            uint pixel_1 = ((32u * at_2.y) + at_2.x);
            if (ids_now) {
                uint _e71 = atomicOr(small_depths[pixel_1], 0u);
                if ((_e71 == bits)) {
                    uint _e76 = atomicMin(small_ids[pixel_1], t_2.id);
                }
            } else {
                uint _e79 = atomicMax(small_depths[pixel_1], bits);
                if ((_e79 < bits)) {
                    atomicExchange(small_ids[pixel_1], NOBODY);
                }
            }
        }
    }
    return;
}

void take_small(uvec2 first_1) {
    uint k_3 = 0u;
    uint i_2 = 0u;
    bool local_19 = false;
    bool local_20 = false;
    bool loop_init_5 = true;
    while(true) {
        if (!loop_init_5) {
            uint _e73 = k_3;
            k_3 = (_e73 + 1u);
        }
        loop_init_5 = false;
        uint _e3 = k_3;
        if ((_e3 < STRIPS)) {
        } else {
            break;
        }
        {
            i_2 = 0u;
            bool loop_init_6 = true;
            while(true) {
                if (!loop_init_6) {
                    uint _e70 = i_2;
                    i_2 = (_e70 + 1u);
                }
                loop_init_6 = false;
                uint _e8 = i_2;
                if ((_e8 < 4u)) {
                } else {
                    break;
                }
                {
                    uint _e14 = k_3;
                    uint _e20 = i_2;
                    uint pixel_2 = (((32u * (first_1.y + (8u * _e14))) + first_1.x) + _e20);
                    uint _e24 = atomicOr(small_depths[pixel_2], 0u);
                    float depth_2 = uintBitsToFloat(_e24);
                    uint id_1 = atomicOr(small_ids[pixel_2], 0u);
                    uint _e30 = k_3;
                    uint _e32 = i_2;
                    float _e34 = depths[_e30][_e32];
                    if (!((depth_2 > _e34))) {
                        uint _e40 = k_3;
                        uint _e42 = i_2;
                        float _e44 = depths[_e40][_e42];
                        if ((depth_2 == _e44)) {
                            uint _e49 = k_3;
                            uint _e51 = i_2;
                            uint _e53 = ids[_e49][_e51];
                            local_20 = (id_1 < _e53);
                        } else {
                            local_20 = false;
                        }
                        bool _e56 = local_20;
                        local_19 = _e56;
                    } else {
                        local_19 = true;
                    }
                    bool _e58 = local_19;
                    if (_e58) {
                        uint _e60 = k_3;
                        uint _e62 = i_2;
                        depths[_e60][_e62] = depth_2;
                        uint _e65 = k_3;
                        uint _e67 = i_2;
                        ids[_e65][_e67] = id_1;
                    }
                }
            }
        }
    }
    return;
}

void test(vec4 x_2, float y_2) {
    uint i_3 = 0u;
    uint k_4 = 0u;
    bool local_21 = false;
    uint _e4 = _group_1_binding_1_cs.resolution;
    float n_8 = float(_e4);
    uint count_2 = atomicOr(ready_count, 0u);
    bool loop_init_7 = true;
    while(true) {
        if (!loop_init_7) {
            uint _e81 = i_3;
            i_3 = (_e81 + 1u);
        }
        loop_init_7 = false;
        uint _e10 = i_3;
        if ((_e10 < count_2)) {
        } else {
            break;
        }
        {
            uint _e13 = i_3;
            Ready t_3 = ready[_e13];
            k_4 = 0u;
            bool loop_init_8 = true;
            while(true) {
                if (!loop_init_8) {
                    uint _e78 = k_4;
                    k_4 = (_e78 + 1u);
                }
                loop_init_8 = false;
                uint _e18 = k_4;
                if ((_e18 < STRIPS)) {
                } else {
                    break;
                }
                {
                    uint _e21 = k_4;
                    float down = (y_2 + (16.0 * float(_e21)));
                    if (!((down < t_3.low))) {
                        local_21 = (down > t_3.high);
                    } else {
                        local_21 = true;
                    }
                    bool _e34 = local_21;
                    if (_e34) {
                        continue;
                    }
                    bvec4 _e37 = is_inside(t_3.sides[0], x_2, down, n_8);
                    bvec4 _e40 = is_inside(t_3.sides[1], x_2, down, n_8);
                    bvec4 _e44 = is_inside(t_3.sides[2], x_2, down, n_8);
                    bvec4 inside_1 = bvec4(bvec4(_e37.x && _e40.x, _e37.y && _e40.y, _e37.z && _e40.z, _e37.w && _e40.w).x && _e44.x, bvec4(_e37.x && _e40.x, _e37.y && _e40.y, _e37.z && _e40.z, _e37.w && _e40.w).y && _e44.y, bvec4(_e37.x && _e40.x, _e37.y && _e40.y, _e37.z && _e40.z, _e37.w && _e40.w).z && _e44.z, bvec4(_e37.x && _e40.x, _e37.y && _e40.y, _e37.z && _e40.z, _e37.w && _e40.w).w && _e44.w);
                    vec4 _e46 = depth_at(t_3, x_2, down, n_8);
                    uint _e48 = k_4;
                    vec4 best = depths[_e48];
                    uint _e56 = k_4;
                    uvec4 _e58 = ids[_e56];
                    bvec4 nearer = bvec4(inside_1.x && bvec4(greaterThan(_e46, best).x || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).x, greaterThan(_e46, best).y || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).y, greaterThan(_e46, best).z || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).z, greaterThan(_e46, best).w || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).w).x, inside_1.y && bvec4(greaterThan(_e46, best).x || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).x, greaterThan(_e46, best).y || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).y, greaterThan(_e46, best).z || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).z, greaterThan(_e46, best).w || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).w).y, inside_1.z && bvec4(greaterThan(_e46, best).x || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).x, greaterThan(_e46, best).y || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).y, greaterThan(_e46, best).z || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).z, greaterThan(_e46, best).w || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).w).z, inside_1.w && bvec4(greaterThan(_e46, best).x || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).x, greaterThan(_e46, best).y || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).y, greaterThan(_e46, best).z || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).z, greaterThan(_e46, best).w || bvec4(equal(_e46, best).x && lessThan(uvec4(t_3.id), _e58).x, equal(_e46, best).y && lessThan(uvec4(t_3.id), _e58).y, equal(_e46, best).z && lessThan(uvec4(t_3.id), _e58).z, equal(_e46, best).w && lessThan(uvec4(t_3.id), _e58).w).w).w);
                    uint _e64 = k_4;
                    depths[_e64] = mix(best, _e46, nearer);
                    uint _e68 = k_4;
                    uint _e71 = k_4;
                    uvec4 _e73 = ids[_e71];
                    ids[_e68] = mix(_e73, uvec4(t_3.id), nearer);
                }
            }
        }
    }
    return;
}

uint choose(uint place_2) {
    uint _e2 = atomicOr(listed, 0u);
    if ((place_2 >= _e2)) {
        return NOBODY;
    }
    uint i_6 = sorted[(RUNS + place_2)];
    uint _e12 = numbers[i_6];
    float _e16 = bounds[i_6];
    uint _e18 = atomicOr(farthest, 0u);
    return ((_e16 < uintBitsToFloat(_e18)) ? NOBODY : _e12);
}

void draw_listed(uint local_22, View v_14, Tile tile_6, vec4 x_3, float y_3) {
    uint place_3 = 0u;
    uint part = 0u;
    Ready mine = Ready(vec4[3](vec4(0.0), vec4(0.0), vec4(0.0)), vec4(0.0), 0.0, 0.0, 0u, 0.0, 0.0, uvec4(0u));
    vec4 least = vec4(0.0);
    uint k_5 = 0u;
    while(true) {
        if ((local_22 == 0u)) {
            uint _e10 = place_3;
            uint _e11 = choose(_e10);
            chosen = _e11;
        }
        memoryBarrierShared();
        barrier();
        uint _e13 = chosen;
        memoryBarrierShared();
        barrier();
        if ((_e13 == NOBODY)) {
            break;
        }
        uint _e17 = place_3;
        place_3 = (_e17 + 1u);
        uint _e22 = _group_1_binding_3_cs[_e13].first_index;
        uint first_5 = (_e22 / 3u);
        uint _e28 = _group_1_binding_3_cs[_e13].index_count;
        uint count_3 = (_e28 / 3u);
        part = 0u;
        bool loop_init_9 = true;
        while(true) {
            if (!loop_init_9) {
                uint _e70 = part;
                part = (_e70 + GROUP);
            }
            loop_init_9 = false;
            uint _e33 = part;
            if ((_e33 < count_3)) {
            } else {
                break;
            }
            {
                if ((local_22 == 0u)) {
                    atomicExchange(ready_count, 0u);
                }
                memoryBarrierShared();
                barrier();
                mine = Ready(vec4[3](vec4(0.0), vec4(0.0), vec4(0.0)), vec4(0.0), 0.0, 0.0, 0u, 0.0, 0.0, uvec4(0u));
                mine.box = uvec4(0u);
                uint _e44 = part;
                if (((_e44 + local_22) < count_3)) {
                    uint _e47 = part;
                    Ready _e50 = prepare(v_14, tile_6, ((first_5 + _e47) + local_22));
                    mine = _e50;
                }
                uint _e53 = mine.box.z;
                uint _e56 = mine.box.w;
                bool is_small = ((_e53 * _e56) <= FEW);
                if (is_small) {
                    Ready _e60 = mine;
                    draw_small(tile_6, _e60, false);
                } else {
                    uint _e65 = atomicAdd(ready_count, 1u);
                    Ready _e67 = mine;
                    ready[_e65] = _e67;
                }
                memoryBarrierShared();
                barrier();
                if (is_small) {
                    Ready _e68 = mine;
                    draw_small(tile_6, _e68, true);
                }
                test(x_3, y_3);
                memoryBarrierShared();
                barrier();
            }
        }
        take_small(uvec2((4u * (local_22 % 8u)), (local_22 / 8u)));
        if ((local_22 == 0u)) {
            atomicExchange(farthest, 2130706432u);
        }
        memoryBarrierShared();
        barrier();
        vec4 _e86 = depths[0];
        least = _e86;
        k_5 = 1u;
        bool loop_init_10 = true;
        while(true) {
            if (!loop_init_10) {
                uint _e100 = k_5;
                k_5 = (_e100 + 1u);
            }
            loop_init_10 = false;
            uint _e90 = k_5;
            if ((_e90 < STRIPS)) {
            } else {
                break;
            }
            {
                vec4 _e93 = least;
                uint _e95 = k_5;
                vec4 _e97 = depths[_e95];
                least = min(_e93, _e97);
            }
        }
        float _e103 = least.x;
        float _e105 = least.y;
        float _e108 = least.z;
        float _e110 = least.w;
        float of_all = min(min(_e103, _e105), min(_e108, _e110));
        uint _e115 = atomicMin(farthest, floatBitsToUint(of_all));
        memoryBarrierShared();
        barrier();
    }
    return;
}

void draw(uint local_23, View v_15, Tile tile_7) {
    uint k_6 = 0u;
    uint pixel = 0u;
    uint next_run = 0u;
    uint place_4 = 0u;
    uint n_9 = _group_1_binding_1_cs.resolution;
    uvec2 at_3 = (tile_7.first + uvec2((4u * (local_23 % 8u)), (local_23 / 8u)));
    vec4 x_7 = (vec4((tile_7.ends.x + float((8u * (local_23 % 8u))))) + vec4(0.0, 2.0, 4.0, 6.0));
    float y_6 = (tile_7.ends.y + float((2u * (local_23 / 8u))));
    bool loop_init_11 = true;
    while(true) {
        if (!loop_init_11) {
            uint _e80 = k_6;
            k_6 = (_e80 + 1u);
        }
        loop_init_11 = false;
        uint _e40 = k_6;
        if ((_e40 < STRIPS)) {
        } else {
            break;
        }
        {
            uint _e45 = k_6;
            bvec4 is_beyond_1 = bvec4(bvec4(((at_3.y + (8u * _e45)) >= v_15.rows)).x || greaterThanEqual((uvec4(0u, 1u, 2u, 3u) + uvec4(at_3.x)), uvec4(n_9)).x, bvec4(((at_3.y + (8u * _e45)) >= v_15.rows)).y || greaterThanEqual((uvec4(0u, 1u, 2u, 3u) + uvec4(at_3.x)), uvec4(n_9)).y, bvec4(((at_3.y + (8u * _e45)) >= v_15.rows)).z || greaterThanEqual((uvec4(0u, 1u, 2u, 3u) + uvec4(at_3.x)), uvec4(n_9)).z, bvec4(((at_3.y + (8u * _e45)) >= v_15.rows)).w || greaterThanEqual((uvec4(0u, 1u, 2u, 3u) + uvec4(at_3.x)), uvec4(n_9)).w);
            uint _e63 = k_6;
            depths[_e63] = mix(vec4(0.0), vec4(3e38), is_beyond_1);
            uint _e71 = k_6;
            uint _e75 = _group_1_binding_1_cs.patch_count;
            ids[_e71] = uvec4((_e75 + 1u));
        }
    }
    pixel = local_23;
    bool loop_init_12 = true;
    while(true) {
        if (!loop_init_12) {
            uint _e94 = pixel;
            pixel = (_e94 + GROUP);
        }
        loop_init_12 = false;
        uint _e83 = pixel;
        if ((_e83 < PIXELS)) {
        } else {
            break;
        }
        {
            uint _e87 = pixel;
            atomicExchange(small_depths[_e87], 0u);
            uint _e91 = pixel;
            atomicExchange(small_ids[_e91], NOBODY);
        }
    }
    if ((local_23 == 0u)) {
        atomicExchange(farthest, 0u);
    }
    while(true) {
        uint _e103 = next_run;
        uint _e106 = _group_1_binding_1_cs.run_count;
        if ((_e103 < _e106)) {
        } else {
            break;
        }
        {
            uint _e108 = next_run;
            uvec2 _e109 = list_runs(local_23, v_15, tile_7, _e108);
            next_run = _e109.x;
            place_4 = 0u;
            while(true) {
                uint _e113 = place_4;
                uvec3 _e115 = list_chunks(local_23, v_15, tile_7, _e113, _e109.y);
                place_4 = _e115.x;
                draw_listed(local_23, v_15, tile_7, x_7, y_6);
                if ((_e115.z == 0u)) {
                    break;
                }
            }
        }
    }
    return;
}

void add(uint layer, uint id, uint weight) {
    bool local_24 = false;
    uint _e6 = _group_1_binding_1_cs.patch_count;
    uint _e12 = atomicAdd(_group_1_binding_13_cs[((layer * (_e6 + 2u)) + id)], weight);
    if ((_e12 == 0u)) {
        uint _e19 = _group_1_binding_1_cs.patch_count;
        local_24 = (id < _e19);
    } else {
        local_24 = false;
    }
    bool _e22 = local_24;
    if (_e22) {
        uint _e26 = _group_1_binding_1_cs.word_count;
        uint _e36 = atomicOr(_group_1_binding_14_cs[((layer * _e26) + (id / 32u))], (1u << (id % 32u)));
        return;
    } else {
        return;
    }
}

void add_up(uint local_25, View v_16, Tile tile_8) {
    uint k_7 = 0u;
    bool local_26 = false;
    uvec4 rest = uvec4(0u);
    uint i_4 = 0u;
    uint n_10 = _group_1_binding_1_cs.resolution;
    bool loop_init_13 = true;
    while(true) {
        if (!loop_init_13) {
            uint _e107 = k_7;
            k_7 = (_e107 + 1u);
        }
        loop_init_13 = false;
        uint _e8 = k_7;
        if ((_e8 < STRIPS)) {
        } else {
            break;
        }
        {
            uint _e19 = k_7;
            uvec2 at_4 = (tile_8.first + uvec2((4u * (local_25 % 8u)), ((local_25 / 8u) + (8u * _e19))));
            if ((at_4.x < n_10)) {
                local_26 = (at_4.y < v_16.rows);
            } else {
                local_26 = false;
            }
            bool _e32 = local_26;
            if (_e32) {
                uint pixel_3 = (((v_16.first_row + at_4.y) * n_10) + at_4.x);
                uint _e41 = _group_1_binding_12_cs[pixel_3];
                uint _e46 = _group_1_binding_12_cs[(pixel_3 + 1u)];
                uint _e51 = _group_1_binding_12_cs[(pixel_3 + 2u)];
                uint _e56 = _group_1_binding_12_cs[(pixel_3 + 3u)];
                rest = uvec4(_e41, _e46, _e51, _e56);
                i_4 = 0u;
                bool loop_init_14 = true;
                while(true) {
                    if (!loop_init_14) {
                        uint _e104 = i_4;
                        i_4 = (_e104 + 1u);
                    }
                    loop_init_14 = false;
                    uint _e61 = i_4;
                    if ((_e61 < 4u)) {
                    } else {
                        break;
                    }
                    {
                        uint _e64 = i_4;
                        uint _e66 = rest[_e64];
                        if ((_e66 != 0u)) {
                            uint _e70 = k_7;
                            uvec4 _e72 = ids[_e70];
                            uint _e74 = k_7;
                            uint _e76 = i_4;
                            uint _e78 = ids[_e74][_e76];
                            bvec4 same = equal(_e72, uvec4(_e78));
                            uvec4 _e83 = rest;
                            uvec4 these = mix(uvec4(0u), _e83, same);
                            uint _e87 = k_7;
                            uint _e89 = i_4;
                            uint _e91 = ids[_e87][_e89];
                            add(v_16.layer, _e91, (((these.x + these.y) + these.z) + these.w));
                            uvec4 _e99 = rest;
                            rest = mix(_e99, uvec4(0u), same);
                        }
                    }
                }
            }
        }
    }
    return;
}

uvec3 tiles_of_faces() {
    uint n_11 = _group_1_binding_1_cs.resolution;
    return uvec3(((n_11 + 31u) / 32u), (((n_11 + HIGH) - 1u) / HIGH), ((((n_11 / 2u) + HIGH) - 1u) / HIGH));
}

uint tiles_of_hemicube() {
    uvec3 _e0 = tiles_of_faces();
    return (_e0.x * (_e0.y + (4u * _e0.z)));
}

uvec3 place_of(uint number_4, uint of_layer) {
    uvec3 _e2 = tiles_of_faces();
    uint _e6 = _group_0_binding_0_cs.slot;
    uint first_view = (5u * (_e6 + (number_4 / of_layer)));
    uint column = ((number_4 % of_layer) % _e2.x);
    uint row = ((number_4 % of_layer) / _e2.x);
    if ((row < _e2.y)) {
        return uvec3(column, row, first_view);
    }
    return uvec3(column, ((row - _e2.y) % _e2.z), ((first_view + 1u) + ((row - _e2.y) / _e2.z)));
}

uint take_tile(uint local_27, uint drawn_2) {
    if ((local_27 == 0u)) {
        chosen = NOBODY;
        uint _e8 = _group_1_binding_1_cs.tiles_each;
        if ((drawn_2 < _e8)) {
            uint _e14 = _group_1_binding_1_cs.queue;
            uint _e17 = atomicAdd(_group_1_binding_13_cs[_e14], 1u);
            chosen = _e17;
        }
    }
    memoryBarrierShared();
    barrier();
    uint _e19 = chosen;
    memoryBarrierShared();
    barrier();
    return _e19;
}

bool loops_go_on() {
    uint at = 0u;
    while(true) {
        uint _e2 = at;
        uint _e5 = _group_1_binding_1_cs.resolution;
        if ((_e2 < _e5)) {
        } else {
            break;
        }
        {
            uint _e7 = at;
            at = (_e7 + 8u);
        }
    }
    uint _e10 = at;
    uint _e13 = _group_1_binding_1_cs.resolution;
    return (_e10 >= _e13);
}

void draw_whole(uint local_28, View v_17, Tile tile_9) {
    draw(local_28, v_17, tile_9);
    bool _e3 = loops_go_on();
    if (_e3) {
        add_up(local_28, v_17, tile_9);
        return;
    } else {
        return;
    }
}

void main() {
    uint local = gl_LocalInvocationIndex;
    uvec3 groups = gl_NumWorkGroups;
    uint drawn = 0u;
    uint number = 0u;
    uint _e2 = tiles_of_hemicube();
    uint _e6 = take_tile(local, 0u);
    number = _e6;
    bool loop_init_15 = true;
    while(true) {
        if (!loop_init_15) {
            uint _e23 = drawn;
            uint _e24 = take_tile(local, _e23);
            number = _e24;
        }
        loop_init_15 = false;
        uint _e8 = number;
        if ((_e8 < (groups.y * _e2))) {
        } else {
            break;
        }
        {
            uint _e12 = number;
            uvec3 _e13 = place_of(_e12, _e2);
            View v_19 = _group_1_binding_2_cs[_e13.z];
            Tile _e19 = tile_of(v_19, _e13.xy);
            draw_whole(local, v_19, _e19);
            uint _e21 = drawn;
            drawn = (_e21 + 1u);
        }
    }
    return;
}

