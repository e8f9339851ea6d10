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
const uint GROUP = 64u;
const uint FEW = 64u;

layout(std140, binding = 0) uniform View_block_0Compute { View _group_0_binding_0_cs; };

layout(std140, binding = 1) uniform Settings_block_1Compute { Settings _group_1_binding_1_cs; };

layout(std430, binding = 2) readonly buffer type_6_block_2Compute { View _group_1_binding_2_cs[]; };

layout(binding = 11) uniform usampler2DArray _group_1_binding_11_cs;

layout(std430, binding = 12) readonly buffer type_10_block_3Compute { uint _group_1_binding_12_cs[]; };

layout(std430, binding = 15) readonly buffer type_11_block_4Compute { Vertex _group_1_binding_15_cs[]; };

layout(std430, binding = 16) readonly buffer type_10_block_5Compute { uint _group_1_binding_16_cs[]; };

layout(std430, binding = 17) readonly buffer type_10_block_6Compute { uint _group_1_binding_17_cs[]; };

layout(std430, binding = 18) readonly buffer type_10_block_7Compute { uint _group_1_binding_18_cs[]; };

layout(std430, binding = 21) readonly buffer type_10_block_8Compute { uint _group_1_binding_21_cs[]; };

layout(std430, binding = 22) buffer type_13_block_9Compute { uint _group_1_binding_22_cs[]; };

shared uvec2 many[320];

shared uint many_count;


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
    float height_1 = (((normal.x * _e4.x) + (normal.y * _e4.y)) + (normal.z * _e4.z));
    vec3 n = vec3((((v_4.tangent.x * normal.x) + (v_4.tangent.y * normal.y)) + (v_4.tangent.z * normal.z)), (((v_4.bitangent.x * normal.x) + (v_4.bitangent.y * normal.y)) + (v_4.bitangent.z * normal.z)), (((v_4.normal.x * normal.x) + (v_4.normal.y * normal.y)) + (v_4.normal.z * normal.z)));
    vec3 _e59 = on_face(v_4, n);
    vec3 q = vec3(_e59.x, ((v_4.upside_down == 1u) ? -(_e59.y) : _e59.y), _e59.z);
    float up = (0.25 * (q.y + q.z));
    vec3 coefficients = ((v_4.face == 0u) ? q : vec3(q.x, up, (up + q.z)));
    float error = ((((abs(_e4.x) + abs(_e4.y)) + abs(_e4.z)) * 2.3841858e-7) / abs(height_1));
    return vec4((coefficients * (v_4.near / height_1)), error);
}

float depth_of(View v_5, vec4 plane, vec4 position) {
    uint _e8 = _group_1_binding_1_cs.resolution;
    float x_1 = (((2.0 * position.x) / float(_e8)) - 1.0);
    float y_1 = (((2.0 * (position.y - float(v_5.first_row))) / float(v_5.rows)) - 1.0);
    float depth_1 = min(fma(plane.x, x_1, fma(plane.y, y_1, plane.z)), 1.0);
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
    float first_1 = ((edge.x != 0.0) ? edge.x : ((edge.y != 0.0) ? edge.y : edge.z));
    return ((_e2 == 0.0) ? first_1 : _e2);
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
    bool local_1 = false;
    vec3 _e5 = high_of(d_1);
    vec3 _e6 = high_of(c_3);
    vec3 _e8 = low_of(d_1);
    vec3 _e9 = low_of(c_3);
    vec3 _e12 = along(a_6, ((_e5 - _e6) + (_e8 - _e9)));
    float _e13 = height_of(a_6, from_place);
    float _e14 = height_of(a_6, to_place);
    float _e15 = height_of(a_6, _e12);
    if (!((_e13 == 0.0))) {
        local_1 = (_e14 == 0.0);
    } else {
        local_1 = true;
    }
    bool _e25 = local_1;
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

uvec4 box_of(View v_9, Outline t) {
    bool local_2 = false;
    uint _e4 = _group_1_binding_1_cs.resolution;
    float n_1 = float(_e4);
    vec2 size = vec2(n_1, float(v_9.rows));
    vec3 z_1 = vec3(t.corners[0].z, t.corners[1].z, t.corners[2].z);
    if (!((t.volume == 0.0))) {
        local_2 = (max(max(z_1.x, z_1.y), z_1.z) <= 0.0);
    } else {
        local_2 = true;
    }
    bool _e33 = local_2;
    if (_e33) {
        return uvec4(0u);
    }
    if ((min(min(z_1.x, z_1.y), z_1.z) <= 0.0)) {
        return uvec4(uvec2(0u), uvec2(size));
    }
    vec2 p_3 = (t.corners[0].xy / vec2(z_1.x));
    vec2 q_1 = (t.corners[1].xy / vec2(z_1.y));
    vec2 r_1 = (t.corners[2].xy / vec2(z_1.z));
    vec2 shift = ((vec2(n_1, ((v_9.face == 0u) ? n_1 : 0.0)) * 0.5) - vec2(0.5));
    vec2 low_3 = ceil(clamp((((min(min(p_3, q_1), r_1) * (0.5 * n_1)) + shift) - vec2(0.01)), vec2(0.0), size));
    vec2 high_3 = floor(clamp((((max(max(p_3, q_1), r_1) * (0.5 * n_1)) + shift) + vec2(1.01)), vec2(0.0), size));
    return uvec4(uvec2(low_3), uvec2(max(low_3, high_3)));
}

uint hidden_in(View v_10, Outline t_1, uvec4 box, uint id, uint first, uint step_) {
    uint sum_1 = 0u;
    uint i_1 = 0u;
    bool local_3 = false;
    bool local_4 = false;
    uint n_2 = _group_1_binding_1_cs.resolution;
    uint wide = (box.z - box.x);
    uint all_ = (wide * (box.w - box.y));
    ivec2 shift_1 = ivec2(uvec2(n_2, ((v_10.face == 0u) ? n_2 : 0u)));
    i_1 = first;
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e90 = i_1;
            i_1 = (_e90 + step_);
        }
        loop_init = false;
        uint _e26 = i_1;
        if ((_e26 < all_)) {
        } else {
            break;
        }
        {
            uint _e29 = i_1;
            uint _e31 = i_1;
            uvec2 at = (box.xy + uvec2((_e29 % wide), (_e31 / wide)));
            vec3 direction_1 = vec3(vec2((ivec2(((2u * at) + uvec2(1u))) - shift_1)), float(n_2));
            float _e47 = side_of(t_1.sides[0], direction_1);
            if ((_e47 > 0.0)) {
                float _e54 = side_of(t_1.sides[1], direction_1);
                local_3 = (_e54 > 0.0);
            } else {
                local_3 = false;
            }
            bool _e58 = local_3;
            if (_e58) {
                float _e63 = side_of(t_1.sides[2], direction_1);
                local_4 = (_e63 > 0.0);
            } else {
                local_4 = false;
            }
            bool inside = local_4;
            if (inside) {
                uvec2 there = uvec2(at.x, (at.y + v_10.first_row));
                uvec4 _e78 = texelFetch(_group_1_binding_11_cs, ivec3(ivec2(there), int(v_10.layer)), 0);
                if ((_e78.x != id)) {
                    uint _e81 = sum_1;
                    uint _e88 = _group_1_binding_12_cs[((there.y * n_2) + there.x)];
                    sum_1 = (_e81 + _e88);
                }
            }
        }
    }
    uint _e92 = sum_1;
    return _e92;
}

Outline outline_of(View v_11, uint id_1) {
    uint _e5 = _group_1_binding_17_cs[id_1];
    uint corner = (3u * _e5);
    Axes _e7 = axes_of(v_11);
    uint _e11 = _group_1_binding_16_cs[corner];
    Vertex _e13 = _group_1_binding_15_cs[_e11];
    uint _e19 = _group_1_binding_16_cs[(corner + 1u)];
    Vertex _e21 = _group_1_binding_15_cs[_e19];
    uint _e27 = _group_1_binding_16_cs[(corner + 2u)];
    Vertex _e29 = _group_1_binding_15_cs[_e27];
    Outline _e30 = outline(v_11, _e7, _e13, _e21, _e29);
    return _e30;
}

void main() {
    uint local = gl_LocalInvocationIndex;
    uvec3 group = gl_WorkGroupID;
    uvec3 groups = gl_NumWorkGroups;
    uint begin = 0u;
    uint sum = 0u;
    uint face = 0u;
    uint i = 0u;
    uint _e5 = _group_0_binding_0_cs.slot;
    uint slot = (_e5 + group.y);
    uint _e10 = _group_0_binding_0_cs.layer;
    uint _e15 = _group_1_binding_1_cs.capacity;
    uint base = ((_e10 + group.y) * _e15);
    uint count = _group_1_binding_21_cs[(4u * slot)];
    begin = (group.x * GROUP);
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            uint _e130 = begin;
            begin = (_e130 + (groups.x * GROUP));
        }
        loop_init_1 = false;
        uint _e26 = begin;
        if ((_e26 < count)) {
        } else {
            break;
        }
        {
            if ((local == 0u)) {
                atomicExchange(many_count, 0u);
            }
            memoryBarrierShared();
            barrier();
            uint _e32 = begin;
            uint entry = (_e32 + local);
            if ((entry < count)) {
                uint id_2 = _group_1_binding_18_cs[(2u * (base + entry))];
                sum = 0u;
                face = 0u;
                bool loop_init_2 = true;
                while(true) {
                    if (!loop_init_2) {
                        uint _e79 = face;
                        face = (_e79 + 1u);
                    }
                    loop_init_2 = false;
                    uint _e45 = face;
                    if ((_e45 < 5u)) {
                    } else {
                        break;
                    }
                    {
                        uint _e51 = face;
                        View v_12 = _group_1_binding_2_cs[((slot * 5u) + _e51)];
                        Outline _e55 = outline_of(v_12, id_2);
                        uvec4 _e56 = box_of(v_12, _e55);
                        if ((((_e56.z - _e56.x) * (_e56.w - _e56.y)) > FEW)) {
                            uint _e69 = atomicAdd(many_count, 1u);
                            uint _e71 = face;
                            many[_e69] = uvec2(entry, _e71);
                        } else {
                            uint _e73 = sum;
                            uint _e76 = hidden_in(v_12, _e55, _e56, id_2, 0u, 1u);
                            sum = (_e73 + _e76);
                        }
                    }
                }
                uint _e84 = sum;
                uint _e85 = atomicAdd(_group_1_binding_22_cs[(base + entry)], _e84);
            }
            memoryBarrierShared();
            barrier();
            uint large = atomicOr(many_count, 0u);
            i = 0u;
            bool loop_init_3 = true;
            while(true) {
                if (!loop_init_3) {
                    uint _e128 = i;
                    i = (_e128 + 1u);
                }
                loop_init_3 = false;
                uint _e90 = i;
                if ((_e90 < large)) {
                } else {
                    break;
                }
                {
                    uint _e95 = i;
                    uint _e98 = many[_e95].x;
                    uint id_3 = _group_1_binding_18_cs[(2u * (base + _e98))];
                    uint _e107 = i;
                    uint _e110 = many[_e107].y;
                    View v_13 = _group_1_binding_2_cs[((slot * 5u) + _e110)];
                    Outline _e114 = outline_of(v_13, id_3);
                    uint _e117 = i;
                    uint _e120 = many[_e117].x;
                    uvec4 _e123 = box_of(v_13, _e114);
                    uint _e125 = hidden_in(v_13, _e114, _e123, id_3, local, GROUP);
                    uint _e126 = atomicAdd(_group_1_binding_22_cs[(base + _e120)], _e125);
                }
            }
            memoryBarrierShared();
            barrier();
        }
    }
    return;
}

