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
struct Triangle {
    vec3 places[3];
    vec3 sides[3];
};
struct There {
    float nearness;
    vec3 sides;
    bool is_back;
};
struct Found {
    uint id;
    float nearness;
    bool ended;
};
const uint RUN = 32u;
const uint GROUP = 64u;
const float NEAR_CENTRE = 0.0078125;
const float IN_FRONT = 1.00001;
const uint MOST_BESIDE = 8u;
const uint OUTSIDE = 2147483648u;

layout(std140, binding = 0) uniform View_block_0Compute { View _group_0_binding_0_cs; };

layout(std140, binding = 1) uniform Settings_block_1Compute { Settings _group_1_binding_1_cs; };

layout(std430, binding = 13) buffer type_12_block_2Compute { uint _group_1_binding_13_cs[]; };

layout(std430, binding = 14) buffer type_12_block_3Compute { uint _group_1_binding_14_cs[]; };

layout(std430, binding = 26) buffer type_12_block_4Compute { uint _group_1_binding_26_cs[]; };

layout(std430, binding = 27) buffer type_10_block_5Compute { uint _group_1_binding_27_cs[]; };

layout(binding = 0,r32ui) writeonly uniform uimage2DArray _group_1_binding_29_cs;


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

vec3 on_face(View v_2, vec3 p_1) {
    return vec3((((v_2.clip_x.x * p_1.x) + (v_2.clip_x.y * p_1.y)) + (v_2.clip_x.z * p_1.z)), (((v_2.clip_y.x * p_1.x) + (v_2.clip_y.y * p_1.y)) + (v_2.clip_y.z * p_1.z)), (((v_2.clip_w.x * p_1.x) + (v_2.clip_w.y * p_1.y)) + (v_2.clip_w.z * p_1.z)));
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
    vec3 q_1 = vec3(_e59.x, ((v_4.upside_down == 1u) ? -(_e59.y) : _e59.y), _e59.z);
    float up = (0.25 * (q_1.y + q_1.z));
    vec3 coefficients = ((v_4.face == 0u) ? q_1 : vec3(q_1.x, up, (up + q_1.z)));
    float error = ((((abs(_e4.x) + abs(_e4.y)) + abs(_e4.z)) * 2.3841858e-7) / abs(height_1));
    return vec4((coefficients * (v_4.near / height_1)), error);
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

vec3 along(Axes a_2, vec3 d_1) {
    float _e3 = dot_fused(a_2.right, d_1);
    float _e5 = dot_fused(a_2.up, d_1);
    float _e7 = dot_fused(a_2.forward, d_1);
    return vec3(_e3, _e5, _e7);
}

float height_of(Axes a_3, vec3 p_2) {
    return (a_3.is_top ? p_2.z : p_2.y);
}

vec3 with_height(Axes a_4, vec3 p_3, float height) {
    return (a_4.is_top ? vec3(p_3.xy, height) : vec3(p_3.x, height, p_3.z));
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

vec3 side_on(Axes a_6, Vertex c_3, Vertex d_2, vec3 from_place, vec3 to_place) {
    bool local_7 = false;
    vec3 _e5 = high_of(d_2);
    vec3 _e6 = high_of(c_3);
    vec3 _e8 = low_of(d_2);
    vec3 _e9 = low_of(c_3);
    vec3 _e12 = along(a_6, ((_e5 - _e6) + (_e8 - _e9)));
    float _e13 = height_of(a_6, from_place);
    float _e14 = height_of(a_6, to_place);
    float _e15 = height_of(a_6, _e12);
    if (!((_e13 == 0.0))) {
        local_7 = (_e14 == 0.0);
    } else {
        local_7 = true;
    }
    bool _e25 = local_7;
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
    vec3 sides_1[3] = vec3[3]((turn * _e19), (turn * _e22), (turn * _e25));
    return Outline(vec3[3](_e5, _e6, _e7), sides_1, _e12);
}

uint pixel_count() {
    uint _e3 = _group_1_binding_1_cs.resolution;
    uint _e7 = _group_1_binding_1_cs.resolution;
    return ((3u * _e3) * _e7);
}

uint near_base(uint layer) {
    uint _e1 = pixel_count();
    return (layer * ((_e1 / RUN) + 2u));
}

uint near_count(uint layer_1) {
    uint _e1 = near_base(layer_1);
    uint _e2 = pixel_count();
    return (_e1 + (_e2 / RUN));
}

uint shown_count(uint layer_2) {
    uint _e1 = near_count(layer_2);
    return (_e1 + 1u);
}

uint listed_base(uint layer_3) {
    uint _e3 = pixel_count();
    return ((layer_3 * 4u) * _e3);
}

uint shown_base(uint layer_4) {
    uint _e1 = listed_base(layer_4);
    uint _e3 = pixel_count();
    return (_e1 + (3u * _e3));
}

uint visible_at(uint layer_5, uint id) {
    uint _e4 = _group_1_binding_1_cs.patch_count;
    uint _e7 = _group_1_binding_1_cs.patch_count;
    uint place = ((id > (_e7 + 1u)) ? _e4 : id);
    uint _e14 = _group_1_binding_1_cs.patch_count;
    return ((layer_5 * (_e14 + 2u)) + place);
}

void touch(uint layer_6, uint id_1) {
    uint _e4 = _group_1_binding_1_cs.patch_count;
    if ((id_1 < _e4)) {
        uint _e9 = _group_1_binding_1_cs.word_count;
        uint _e19 = atomicOr(_group_1_binding_14_cs[((layer_6 * _e9) + (id_1 / 32u))], (1u << (id_1 % 32u)));
        return;
    } else {
        return;
    }
}

vec3 turned(View v_9, vec3 d_3) {
    float _e3 = dot_fused(v_9.tangent, d_3);
    float _e5 = dot_fused(v_9.bitangent, d_3);
    float _e7 = dot_fused(v_9.normal, d_3);
    return vec3(_e3, _e5, _e7);
}

vec3 placed(View v_10, Vertex c_5) {
    vec3 _e2 = high_of(c_5);
    vec3 _e5 = low_of(c_5);
    vec3 _e9 = turned(v_10, ((_e2 - v_10.eye_high) + (_e5 - v_10.eye_low)));
    float snap_2 = fma((abs(_e9.x) + abs(_e9.y)), 9.536743e-7, v_10.tolerance);
    return vec3(_e9.xy, ((abs(_e9.z) <= snap_2) ? 0.0 : _e9.z));
}

vec3 between(View v_11, Vertex from_corner, Vertex to_corner, vec3 from_place_1, vec3 to_place_1) {
    bool local_9 = false;
    vec3 _e5 = high_of(to_corner);
    vec3 _e6 = high_of(from_corner);
    vec3 _e8 = low_of(to_corner);
    vec3 _e9 = low_of(from_corner);
    vec3 _e12 = turned(v_11, ((_e5 - _e6) + (_e8 - _e9)));
    if (!((from_place_1.z == 0.0))) {
        local_9 = (to_place_1.z == 0.0);
    } else {
        local_9 = true;
    }
    bool _e28 = local_9;
    return vec3(_e12.xy, (_e28 ? (to_place_1.z - from_place_1.z) : _e12.z));
}

vec3 to_face(uint face_1, vec3 p_4) {
    switch(face_1) {
        case 0u: {
            return p_4;
        }
        case 1u: {
            return p_4.yzx;
        }
        case 2u: {
            return vec3(-(p_4.y), p_4.z, -(p_4.x));
        }
        case 3u: {
            return vec3(-(p_4.x), p_4.z, p_4.y);
        }
        default: {
            return vec3(p_4.x, p_4.z, -(p_4.y));
        }
    }
}

uint face_of_row(uint row) {
    uint n_1 = _group_1_binding_1_cs.resolution;
    return ((row >= n_1) ? (1u + ((row - n_1) / (n_1 / 2u))) : 0u);
}

vec3 centre(uint face_2, uvec2 at_1) {
    uint n_2 = _group_1_binding_1_cs.resolution;
    uint first_row = ((face_2 == 0u) ? 0u : (n_2 + ((face_2 - 1u) * (n_2 / 2u))));
    uint up_2 = ((2u * (at_1.y - first_row)) + 1u);
    ivec2 from_middle = (ivec2(uvec2(((2u * at_1.x) + 1u), up_2)) - ivec2(uvec2(n_2, ((face_2 == 0u) ? n_2 : 0u))));
    return vec3(vec2(from_middle), float(n_2));
}

bool is_inside(There t) {
    return all(greaterThan(t.sides, vec3(0.0)));
}

uint worst(There t_1) {
    uint later = ((t_1.sides.z < t_1.sides.y) ? 2u : 1u);
    return ((min(t_1.sides.y, t_1.sides.z) < t_1.sides.x) ? later : 0u);
}

vec4 within(uint face_6, vec3 p_5) {
    uint _e4 = _group_1_binding_1_cs.resolution;
    float pixel = (2.0 / float(_e4));
    float wide = ((1.0 + pixel) * p_5.z);
    float below = (((face_6 == 0u) ? (1.0 + pixel) : pixel) * p_5.z);
    return vec4((wide - p_5.x), (wide + p_5.x), (wide - p_5.y), (below + p_5.y));
}

bool is_outside(uint face_7, vec3 p_6, vec3 q) {
    vec3 _e3 = to_face(face_7, p_6);
    vec4 _e4 = within(face_7, _e3);
    vec3 _e8 = to_face(face_7, q);
    vec4 _e9 = within(face_7, _e8);
    return any(bvec4(lessThan(_e4, vec4(0.0)).x && lessThan(_e9, vec4(0.0)).x, lessThan(_e4, vec4(0.0)).y && lessThan(_e9, vec4(0.0)).y, lessThan(_e4, vec4(0.0)).z && lessThan(_e9, vec4(0.0)).z, lessThan(_e4, vec4(0.0)).w && lessThan(_e9, vec4(0.0)).w));
}

void main() {
    uvec3 thread_2 = gl_GlobalInvocationID;
    uvec3 groups_2 = gl_NumWorkGroups;
    uint i_4 = 0u;
    bool local_3 = false;
    uint _e4 = _group_0_binding_0_cs.layer;
    uint layer_9 = (_e4 + thread_2.y);
    uint n_3 = _group_1_binding_1_cs.resolution;
    uint _e11 = near_count(layer_9);
    uint count = atomicOr(_group_1_binding_26_cs[_e11], 0u);
    if ((thread_2.x == 0u)) {
        uint _e18 = shown_count(layer_9);
        atomicExchange(_group_1_binding_26_cs[_e18], 0u);
    }
    i_4 = thread_2.x;
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e85 = i_4;
            i_4 = (_e85 + (groups_2.x * GROUP));
        }
        loop_init = false;
        uint _e23 = i_4;
        if ((_e23 < count)) {
        } else {
            break;
        }
        {
            uint _e25 = listed_base(layer_9);
            uint _e27 = i_4;
            uint place_1 = (_e25 + (3u * _e27));
            uint id_6 = _group_1_binding_27_cs[(place_1 + 1u)];
            uint shown = _group_1_binding_27_cs[(place_1 + 2u)];
            if ((id_6 != shown)) {
                uint _e43 = _group_1_binding_27_cs[place_1];
                uint pixel_1 = (_e43 & 2147483647u);
                ivec2 at_2 = ivec2(uvec2((pixel_1 % n_3), (pixel_1 / n_3)));
                imageStore(_group_1_binding_29_cs, ivec3(at_2, int(layer_9)), uvec4(id_6, 0u, 0u, 0u));
                uint _e58 = _group_1_binding_1_cs.patch_count;
                if ((shown < _e58)) {
                    uint _e63 = visible_at(layer_9, shown);
                    uint _e65 = atomicOr(_group_1_binding_13_cs[_e63], 0u);
                    local_3 = (_e65 == 0u);
                } else {
                    local_3 = false;
                }
                bool _e69 = local_3;
                if (_e69) {
                    uint _e73 = _group_1_binding_1_cs.word_count;
                    uint _e84 = atomicAnd(_group_1_binding_14_cs[((layer_9 * _e73) + (shown / 32u))], ~((1u << (shown % 32u))));
                }
            }
        }
    }
    return;
}

