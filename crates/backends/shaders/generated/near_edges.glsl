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

layout(std430, binding = 2) readonly buffer type_6_block_2Compute { View _group_1_binding_2_cs[]; };

layout(std430, binding = 13) buffer type_12_block_3Compute { uint _group_1_binding_13_cs[]; };

layout(std430, binding = 14) buffer type_12_block_4Compute { uint _group_1_binding_14_cs[]; };

layout(std430, binding = 15) readonly buffer type_13_block_5Compute { Vertex _group_1_binding_15_cs[]; };

layout(std430, binding = 16) readonly buffer type_10_block_6Compute { uint _group_1_binding_16_cs[]; };

layout(std430, binding = 17) readonly buffer type_10_block_7Compute { uint _group_1_binding_17_cs[]; };

layout(std430, binding = 26) buffer type_12_block_8Compute { uint _group_1_binding_26_cs[]; };

layout(std430, binding = 27) buffer type_10_block_9Compute { uint _group_1_binding_27_cs[]; };

layout(std430, binding = 28) buffer type_12_block_10Compute { uint _group_1_binding_28_cs[]; };


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

void add_side(uint layer_7, uint id_2, uint weight) {
    bool local_8 = false;
    uint _e7 = _group_1_binding_1_cs.patch_count;
    uint _e14 = atomicAdd(_group_1_binding_28_cs[((layer_7 * ((2u * _e7) + 2u)) + id_2)], weight);
    if ((_e14 == 0u)) {
        local_8 = (weight > 0u);
    } else {
        local_8 = false;
    }
    bool _e22 = local_8;
    if (_e22) {
        uint _e24 = shown_base(layer_7);
        uint _e26 = shown_count(layer_7);
        uint _e29 = atomicAdd(_group_1_binding_26_cs[_e26], 1u);
        _group_1_binding_27_cs[(_e24 + _e29)] = id_2;
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

uint triangle_of(uint id_3) {
    uint _e4 = _group_1_binding_1_cs.patch_count;
    uint _e10 = _group_1_binding_1_cs.patch_count;
    uint _e14 = _group_1_binding_17_cs[((id_3 > _e10) ? ((id_3 - _e4) - 2u) : id_3)];
    return _e14;
}

Triangle triangle(View v_12, uint number) {
    uint _e7 = _group_1_binding_16_cs[(3u * number)];
    Vertex a_8 = _group_1_binding_15_cs[_e7];
    uint _e17 = _group_1_binding_16_cs[((3u * number) + 1u)];
    Vertex b_3 = _group_1_binding_15_cs[_e17];
    uint _e27 = _group_1_binding_16_cs[((3u * number) + 2u)];
    Vertex c_6 = _group_1_binding_15_cs[_e27];
    vec3 _e30 = placed(v_12, a_8);
    vec3 _e31 = placed(v_12, b_3);
    vec3 _e32 = placed(v_12, c_6);
    vec3 _e34 = between(v_12, a_8, b_3, _e30, _e31);
    vec3 _e35 = between(v_12, b_3, c_6, _e31, _e32);
    vec3 _e36 = between(v_12, c_6, a_8, _e32, _e30);
    return Triangle(vec3[3](_e30, _e31, _e32), vec3[3](_e34, _e35, _e36));
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

There there(View v_13, uint number_1, uint face_3, vec3 direction_1) {
    Triangle _e4 = triangle(v_13, number_1);
    vec3 _e7 = to_face(face_3, _e4.places[0]);
    vec3 _e10 = to_face(face_3, _e4.places[1]);
    vec3 _e13 = to_face(face_3, _e4.places[2]);
    vec3 _e16 = to_face(face_3, _e4.sides[0]);
    vec3 _e19 = to_face(face_3, _e4.sides[1]);
    vec3 _e22 = to_face(face_3, _e4.sides[2]);
    vec3 _e23 = cross_fused(_e16, _e19);
    float _e24 = dot_fused(_e23, _e7);
    float turn_1 = ((_e24 > 0.0) ? 1.0 : -1.0);
    vec3 _e31 = cross_fused((_e7 + _e10), _e16);
    float _e33 = side_of((turn_1 * _e31), direction_1);
    vec3 _e35 = cross_fused((_e10 + _e13), _e19);
    float _e37 = side_of((turn_1 * _e35), direction_1);
    vec3 _e39 = cross_fused((_e13 + _e7), _e22);
    float _e41 = side_of((turn_1 * _e39), direction_1);
    vec3 sides_2 = vec3(_e33, _e37, _e41);
    float _e43 = dot_fused(_e23, direction_1);
    return There((_e43 / _e24), sides_2, (_e24 > 0.0));
}

bool is_inside(There t) {
    return all(greaterThan(t.sides, vec3(0.0)));
}

float nearness(View v_14, uint id_4, uint face_4, vec3 direction_2) {
    uint _e4 = triangle_of(id_4);
    There _e5 = there(v_14, _e4, face_4, direction_2);
    bool _e7 = is_inside(_e5);
    return (_e7 ? _e5.nearness : 0.0);
}

uint worst(There t_1) {
    uint later = ((t_1.sides.z < t_1.sides.y) ? 2u : 1u);
    return ((min(t_1.sides.y, t_1.sides.z) < t_1.sides.x) ? later : 0u);
}

Found beside(View v_15, uint id_5, There begin, uint face_5, vec3 direction_3) {
    uint start = 0u;
    uint side = 0u;
    uint step_ = 0u;
    bool local_10 = false;
    bool local_11 = false;
    bool local_12 = false;
    uint _e8 = _group_1_binding_1_cs.triangle_count;
    uint first_of_sides = (3u * _e8);
    uint _e11 = triangle_of(id_5);
    uint _e13 = worst(begin);
    start = ((3u * _e11) + _e13);
    uint _e17 = start;
    uint _e20 = _group_1_binding_16_cs[(first_of_sides + _e17)];
    side = _e20;
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e103 = step_;
            step_ = (_e103 + 1u);
        }
        loop_init = false;
        uint _e24 = step_;
        if ((_e24 < MOST_BESIDE)) {
            uint _e29 = side;
            uint _e30 = start;
            local_10 = (_e29 != _e30);
        } else {
            local_10 = false;
        }
        bool _e33 = local_10;
        if (_e33) {
        } else {
            break;
        }
        {
            uint _e34 = side;
            uint other = (_e34 / 3u);
            There _e37 = there(v_15, other, face_5, direction_3);
            uint _e43 = _group_1_binding_16_cs[(3u * other)];
            Vertex owner = _group_1_binding_15_cs[_e43];
            bool is_folded = (_e37.is_back != begin.is_back);
            bool _e49 = is_inside(_e37);
            if (_e49) {
                local_11 = !(is_folded);
            } else {
                local_11 = false;
            }
            bool _e54 = local_11;
            if (_e54) {
                uint _e58 = _group_1_binding_1_cs.patch_count;
                uint _e66 = _group_1_binding_1_cs.patch_count;
                uint back = ((owner.back == _e66) ? ((_e58 + 2u) + owner.front) : owner.back);
                if (!((owner.front == v_15.emitter))) {
                    local_12 = (owner.back == v_15.emitter);
                } else {
                    local_12 = true;
                }
                bool is_emitter = local_12;
                return Found((_e37.is_back ? back : owner.front), (is_emitter ? 0.0 : _e37.nearness), true);
            }
            uint _e90 = worst(_e37);
            uint _e92 = side;
            uint next = (is_folded ? _e92 : ((3u * other) + _e90));
            uint _e94 = start;
            uint _e95 = side;
            start = ((next == _e95) ? _e94 : next);
            uint _e101 = _group_1_binding_16_cs[(first_of_sides + next)];
            side = _e101;
        }
    }
    uint _e105 = side;
    uint _e106 = start;
    return Found(id_5, 0.0, (_e105 == _e106));
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

void walk(uint layer_8, uint face_8, vec3 from_frame, vec3 along_frame) {
    bool local_13 = false;
    bool local_14 = false;
    float major = 0.0;
    float last = 0.0;
    float minor = 0.0;
    bool local_15 = false;
    bool local_16 = false;
    bool local_17 = false;
    uint _e6 = _group_1_binding_1_cs.resolution;
    float n_3 = float(_e6);
    vec3 _e8 = to_face(face_8, from_frame);
    vec3 _e9 = to_face(face_8, along_frame);
    vec4 _e10 = within(face_8, _e8);
    vec4 _e12 = within(face_8, (_e8 + _e9));
    vec4 crossing = (_e10 / (_e10 - _e12));
    vec4 begins = mix(vec4(0.0), crossing, lessThan(_e10, vec4(0.0)));
    vec4 ends = mix(vec4(1.0), crossing, lessThan(_e12, vec4(0.0)));
    float begin_1 = max(max(begins.x, begins.y), max(begins.z, begins.w));
    float end_1 = min(min(ends.x, ends.y), min(ends.z, ends.w));
    vec3 a_9 = (_e8 + (begin_1 * _e9));
    vec3 b_4 = (_e8 + (end_1 * _e9));
    if ((begin_1 < end_1)) {
        local_13 = (a_9.z > 0.0);
    } else {
        local_13 = false;
    }
    bool _e52 = local_13;
    if (_e52) {
        local_14 = (b_4.z > 0.0);
    } else {
        local_14 = false;
    }
    bool is_seen = local_14;
    vec2 shift = ((vec2(n_3, ((face_8 == 0u) ? n_3 : 0.0)) * 0.5) - vec2(0.5));
    vec2 from_pixel = (((a_9.xy / vec2(a_9.z)) * (0.5 * n_3)) + shift);
    vec2 to_pixel = (((b_4.xy / vec2(b_4.z)) * (0.5 * n_3)) + shift);
    vec2 reach = abs((to_pixel - from_pixel));
    bool is_steep = (reach.y > reach.x);
    vec3 e = cross(_e8, _e9);
    vec2 size = vec2(n_3, ((face_8 == 0u) ? n_3 : (0.5 * n_3)));
    vec2 line = (is_steep ? e.yx : e.xy);
    vec2 shifts = (is_steep ? shift.yx : shift);
    vec2 sizes = (is_steep ? size.yx : size);
    vec2 ends_of = (is_steep ? vec2(from_pixel.y, to_pixel.y) : vec2(from_pixel.x, to_pixel.x));
    float slope = (-(line.x) / line.y);
    float offset = ((shifts.y - (slope * shifts.x)) - (((0.5 * n_3) * e.z) / line.y));
    uint _e129 = _group_1_binding_1_cs.resolution;
    uint _e134 = _group_1_binding_1_cs.resolution;
    uint first_row_1 = ((face_8 == 0u) ? 0u : (_e129 + ((face_8 - 1u) * (_e134 / 2u))));
    major = max(ceil((min(ends_of.x, ends_of.y) - NEAR_CENTRE)), 0.0);
    last = min(floor((max(ends_of.x, ends_of.y) + NEAR_CENTRE)), (sizes.x - 1.0));
    float _e163 = last;
    last = (is_seen ? _e163 : -1.0);
    while(true) {
        float _e166 = major;
        float _e167 = last;
        if ((_e166 <= _e167)) {
        } else {
            break;
        }
        {
            float _e169 = major;
            minor = ((slope * _e169) + offset);
            while(true) {
                float _e173 = minor;
                float _e174 = minor;
                if ((abs((_e173 - roundEven(_e174))) > NEAR_CENTRE)) {
                    float _e182 = major;
                    float _e183 = last;
                    local_15 = (_e182 < _e183);
                } else {
                    local_15 = false;
                }
                bool _e186 = local_15;
                if (_e186) {
                } else {
                    break;
                }
                {
                    float _e187 = major;
                    major = (_e187 + 1.0);
                    float _e190 = major;
                    minor = ((slope * _e190) + offset);
                }
            }
            float _e193 = minor;
            float nearest = roundEven(_e193);
            float _e195 = minor;
            if ((abs((_e195 - nearest)) <= NEAR_CENTRE)) {
                local_16 = (nearest >= 0.0);
            } else {
                local_16 = false;
            }
            bool _e205 = local_16;
            if (_e205) {
                local_17 = (nearest < sizes.y);
            } else {
                local_17 = false;
            }
            bool _e211 = local_17;
            if (_e211) {
                float _e212 = major;
                float _e214 = major;
                uvec2 at_2 = uvec2((is_steep ? vec2(nearest, _e214) : vec2(_e212, nearest)));
                uint _e222 = _group_1_binding_1_cs.resolution;
                uint pixel_1 = (((at_2.y + first_row_1) * _e222) + at_2.x);
                uint bit = (1u << (pixel_1 % RUN));
                uint _e231 = near_base(layer_8);
                uint _e236 = atomicOr(_group_1_binding_26_cs[(_e231 + (pixel_1 / RUN))], bit);
                if (((_e236 & bit) == 0u)) {
                    uint _e241 = listed_base(layer_8);
                    uint _e244 = near_count(layer_8);
                    uint _e247 = atomicAdd(_group_1_binding_26_cs[_e244], 1u);
                    _group_1_binding_27_cs[(_e241 + (3u * _e247))] = pixel_1;
                }
            }
            float _e251 = major;
            major = (_e251 + 1.0);
        }
    }
    return;
}

void main() {
    uvec3 thread = gl_GlobalInvocationID;
    uvec3 groups = gl_NumWorkGroups;
    uint i_1 = 0u;
    uint i_2 = 0u;
    uint faces = 0u;
    vec3 p = vec3(0.0);
    vec3 d = vec3(0.0);
    uint face = 0u;
    uint _e5 = _group_0_binding_0_cs.slot;
    View v_16 = _group_1_binding_2_cs[((_e5 + thread.y) * 5u)];
    uint layer_9 = v_16.layer;
    uint _e14 = shown_count(layer_9);
    uint count = atomicOr(_group_1_binding_26_cs[_e14], 0u);
    i_1 = thread.x;
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            uint _e44 = i_1;
            i_1 = (_e44 + (groups.x * GROUP));
        }
        loop_init_1 = false;
        uint _e19 = i_1;
        if ((_e19 < count)) {
        } else {
            break;
        }
        {
            uint _e22 = shown_base(layer_9);
            uint _e23 = i_1;
            uint id_6 = _group_1_binding_27_cs[(_e22 + _e23)];
            uint _e31 = _group_1_binding_1_cs.patch_count;
            uint _e39 = atomicExchange(_group_1_binding_28_cs[((layer_9 * ((2u * _e31) + 2u)) + id_6)], 0u);
            uint _e41 = visible_at(layer_9, id_6);
            uint _e43 = atomicAdd(_group_1_binding_13_cs[_e41], _e39);
            touch(layer_9, id_6);
        }
    }
    i_2 = thread.x;
    bool loop_init_2 = true;
    while(true) {
        if (!loop_init_2) {
            uint _e135 = i_2;
            i_2 = (_e135 + (groups.x * GROUP));
        }
        loop_init_2 = false;
        uint _e51 = i_2;
        if ((_e51 < (3u * count))) {
        } else {
            break;
        }
        {
            uint _e56 = shown_base(layer_9);
            uint _e57 = i_2;
            uint id_7 = _group_1_binding_27_cs[(_e56 + (_e57 / 3u))];
            uint _e63 = i_2;
            uint k_2 = (_e63 % 3u);
            faces = 0u;
            p = vec3(0.0);
            d = vec3(0.0);
            uint _e76 = _group_1_binding_1_cs.patch_count;
            if ((id_7 != (_e76 + 1u))) {
                uint _e81 = triangle_of(id_7);
                uint corner = (3u * _e81);
                uint _e87 = _group_1_binding_16_cs[(corner + k_2)];
                Vertex a_10 = _group_1_binding_15_cs[_e87];
                uint _e98 = _group_1_binding_16_cs[(corner + ((k_2 + 1u) % 3u))];
                Vertex b_5 = _group_1_binding_15_cs[_e98];
                vec3 _e101 = placed(v_16, a_10);
                p = _e101;
                vec3 _e102 = placed(v_16, b_5);
                vec3 _e103 = p;
                vec3 _e104 = between(v_16, a_10, b_5, _e103, _e102);
                d = _e104;
                face = 0u;
                bool loop_init_3 = true;
                while(true) {
                    if (!loop_init_3) {
                        uint _e121 = face;
                        face = (_e121 + 1u);
                    }
                    loop_init_3 = false;
                    uint _e107 = face;
                    if ((_e107 < 5u)) {
                    } else {
                        break;
                    }
                    {
                        uint _e110 = faces;
                        uint _e112 = face;
                        uint _e115 = face;
                        vec3 _e116 = p;
                        bool _e117 = is_outside(_e115, _e116, _e102);
                        faces = (_e110 | (_e117 ? 0u : (1u << _e112)));
                    }
                }
            }
            while(true) {
                uint _e123 = faces;
                if ((_e123 != 0u)) {
                } else {
                    break;
                }
                {
                    uint _e126 = faces;
                    vec3 _e128 = p;
                    vec3 _e129 = d;
                    walk(layer_9, uint(findLSB(_e126)), _e128, _e129);
                    uint _e130 = faces;
                    uint _e131 = faces;
                    faces = (_e130 & (_e131 - 1u));
                }
            }
        }
    }
    return;
}

