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
struct Ray {
    vec3 start;
    vec3 way;
    vec3 inverse_;
    vec2 shear;
    uint axis;
    float sign_;
    float end;
    float height;
};
struct First {
    uint id;
    float low;
    float high;
    float others;
};
const uint NOTHING = 4294967295u;
const uint DOUBTFUL = 4294967293u;
const uint STACK = 48u;
const uint MOST_TURNS = 8000u;
const float SLACK = 9.536743e-7;
const float NEVER = 1000000000.0;

layout(std430, binding = 30) readonly buffer type_7_block_0Compute { uvec4 _group_1_binding_30_cs[]; };

layout(std430, binding = 31) readonly buffer type_7_block_1Compute { uvec4 _group_1_binding_31_cs[]; };

layout(std430, binding = 32) readonly buffer type_7_block_2Compute { uvec4 _group_1_binding_32_cs[]; };

layout(std430, binding = 33) buffer type_8_block_3Compute { uint _group_1_binding_33_cs[]; };


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
    vec3 q_2 = vec3(_e59.x, ((v_4.upside_down == 1u) ? -(_e59.y) : _e59.y), _e59.z);
    float up = (0.25 * (q_2.y + q_2.z));
    vec3 coefficients = ((v_4.face == 0u) ? q_2 : vec3(q_2.x, up, (up + q_2.z)));
    float error = ((((abs(_e4.x) + abs(_e4.y)) + abs(_e4.z)) * 2.3841858e-7) / abs(height));
    return vec4((coefficients * (v_4.near / height)), error);
}

float behind(vec4 plane_1, float depth) {
    return (depth * (0.9999981 - min(plane_1.w, 0.0009765625)));
}

vec3 turned(vec3 v_6, uint axis) {
    return ((axis == 0u) ? v_6.yzx : ((axis == 1u) ? v_6.zxy : v_6.xyz));
}

vec3 turned_back(vec3 v_7, uint axis_1) {
    return ((axis_1 == 0u) ? v_7.zxy : ((axis_1 == 1u) ? v_7.yzx : v_7.xyz));
}

Ray ray_of(uint at) {
    Ray ray = Ray(vec3(0.0), vec3(0.0), vec3(0.0), vec2(0.0), 0u, 0.0, 0.0, 0.0);
    uvec4 first_2 = _group_1_binding_32_cs[(4u + (2u * at))];
    uvec4 _e14 = _group_1_binding_32_cs[(5u + (2u * at))];
    vec4 second = uintBitsToFloat(_e14);
    uint bits = _group_1_binding_32_cs[(5u + (2u * at))].z;
    ray.start = uintBitsToFloat(first_2.xyz);
    ray.end = uintBitsToFloat(first_2.w);
    ray.shear = second.xy;
    ray.axis = (bits & 3u);
    ray.sign_ = (((bits & 4u) != 0u) ? -1.0 : 1.0);
    ray.height = second.w;
    vec2 _e48 = ray.shear;
    float _e50 = ray.sign_;
    float _e53 = ray.sign_;
    uint _e56 = ray.axis;
    vec3 _e57 = turned_back(vec3((_e48 * _e50), _e53), _e56);
    ray.way = _e57;
    vec3 _e59 = ray.way;
    bvec3 flat_ = lessThan(abs(_e59), vec3(1e-18));
    vec3 _e66 = ray.way;
    ray.inverse_ = mix((vec3(1.0) / _e66), vec3(1e18), flat_);
    Ray _e73 = ray;
    return _e73;
}

bool touches(Ray ray_1, vec3 center, vec3 half_, float until) {
    vec3 middle = ((center - ray_1.start) * ray_1.inverse_);
    vec3 extent = (((half_ + vec3(3.8146973e-6)) * abs(ray_1.inverse_)) + (3.8146973e-6 * abs(middle)));
    vec3 low_4 = (middle - extent);
    vec3 high_4 = (middle + extent);
    float first_3 = max(max(low_4.x, low_4.y), max(low_4.z, 0.0));
    float last = min(min(high_4.x, high_4.y), min(high_4.z, until));
    return (first_3 <= last);
}

float cross_of(vec2 q, vec2 r_1) {
    return ((q.x * r_1.y) - (q.y * r_1.x));
}

float error_of(vec2 q_1, vec2 r_2, float eta) {
    return (((2.0 * eta) * (((abs(q_1.x) + abs(q_1.y)) + abs(r_2.x)) + abs(r_2.y))) + 1e-9);
}

float largest(vec3 v_8) {
    return max(max(v_8.x, v_8.y), v_8.z);
}

float smallest(vec3 v_9) {
    return min(min(v_9.x, v_9.y), v_9.z);
}

First meet(Ray ray_2, uint at_1, First before) {
    First first = First(0u, 0.0, 0.0, 0.0);
    bool local = false;
    bool local_1 = false;
    bool local_2 = false;
    bool local_3 = false;
    float low_3 = 0.0;
    float high_3 = 0.0;
    bool local_4 = false;
    bool local_5 = false;
    bool local_6 = false;
    bool local_7 = false;
    bool local_8 = false;
    first = before;
    uint emitter = _group_1_binding_32_cs[1].x;
    uvec4 words_a = _group_1_binding_31_cs[(3u * at_1)];
    uvec4 words_b = _group_1_binding_31_cs[((3u * at_1) + 1u)];
    uvec4 words_c = _group_1_binding_31_cs[((3u * at_1) + 2u)];
    uvec4 _e29 = _group_1_binding_32_cs[2];
    if (!(any(equal(_e29, uvec4(at_1))))) {
        uvec4 _e38 = _group_1_binding_32_cs[3];
        local = any(equal(_e38, uvec4(at_1)));
    } else {
        local = true;
    }
    bool is_below = local;
    if (!((words_a.w == emitter))) {
        local_1 = (words_b.w == emitter);
    } else {
        local_1 = true;
    }
    bool _e52 = local_1;
    if (!(_e52)) {
        local_2 = is_below;
    } else {
        local_2 = true;
    }
    bool _e57 = local_2;
    if (_e57) {
        First _e58 = first;
        return _e58;
    }
    vec3 a = (uintBitsToFloat(words_a.xyz) - ray_2.start);
    vec3 b = (uintBitsToFloat(words_b.xyz) - ray_2.start);
    vec3 c = (uintBitsToFloat(words_c.xyz) - ray_2.start);
    float _e72 = largest(abs(a));
    float _e74 = largest(abs(b));
    float _e76 = largest(abs(c));
    float far = max(_e72, max(_e74, _e76));
    float eta_1 = (SLACK * (1.0 + far));
    uvec4 _e85 = _group_1_binding_32_cs[0];
    vec4 plane_2 = uintBitsToFloat(_e85);
    float _e94 = largest(vec3(dot(plane_2.xyz, a), dot(plane_2.xyz, b), dot(plane_2.xyz, c)));
    float height_1 = ((_e94 + ray_2.height) - plane_2.w);
    if ((height_1 < (-2.0 * eta_1))) {
        First _e102 = first;
        return _e102;
    }
    vec3 _e104 = turned(a, ray_2.axis);
    vec3 _e106 = turned(b, ray_2.axis);
    vec3 _e108 = turned(c, ray_2.axis);
    vec2 pa = (_e104.xy - (ray_2.shear * _e104.z));
    vec2 pb = (_e106.xy - (ray_2.shear * _e106.z));
    vec2 pc = (_e108.xy - (ray_2.shear * _e108.z));
    float _e124 = cross_of(pb, pc);
    float _e125 = cross_of(pc, pa);
    float _e126 = cross_of(pa, pb);
    vec3 sides = vec3(_e124, _e125, _e126);
    float _e128 = error_of(pb, pc, eta_1);
    float _e129 = error_of(pc, pa, eta_1);
    float _e130 = error_of(pa, pb, eta_1);
    vec3 errors = vec3(_e128, _e129, _e130);
    vec3 over = (sides - errors);
    vec3 under = (sides + errors);
    float _e134 = largest(over);
    if ((_e134 > 0.0)) {
        float _e139 = smallest(under);
        local_3 = (_e139 < 0.0);
    } else {
        local_3 = false;
    }
    bool _e143 = local_3;
    if (_e143) {
        First _e144 = first;
        return _e144;
    }
    vec3 depths = (ray_2.sign_ * vec3(_e104.z, _e106.z, _e108.z));
    float _e151 = smallest(depths);
    float _e152 = largest(depths);
    low_3 = (_e151 - (2.0 * eta_1));
    high_3 = (_e152 + (2.0 * eta_1));
    float volume = ((sides.x + sides.y) + sides.z);
    float error_1 = ((errors.x + errors.y) + errors.z);
    if ((abs(volume) > (2.0 * error_1))) {
        float depth_1 = (_e151 + (dot(sides, (depths - vec3(_e151))) / volume));
        float off = ((((2.0 * error_1) * (_e152 - _e151)) / (abs(volume) - error_1)) + (2.0 * eta_1));
        float _e190 = low_3;
        low_3 = max(_e190, (depth_1 - off));
        float _e193 = high_3;
        high_3 = min(_e193, (depth_1 + off));
    }
    float _e196 = high_3;
    if (!((_e196 < 0.0))) {
        float _e202 = low_3;
        local_4 = (_e202 > (ray_2.end * 1.000001));
    } else {
        local_4 = true;
    }
    bool _e208 = local_4;
    if (_e208) {
        First _e209 = first;
        return _e209;
    }
    float _e210 = smallest(over);
    if (!((_e210 > 0.0))) {
        float _e216 = largest(under);
        local_5 = (_e216 < 0.0);
    } else {
        local_5 = true;
    }
    bool is_within = local_5;
    float _e221 = low_3;
    if ((_e221 > 0.0)) {
        float _e226 = high_3;
        local_6 = (_e226 < (ray_2.end * 0.999999));
    } else {
        local_6 = false;
    }
    bool is_between = local_6;
    if (is_within) {
        local_7 = is_between;
    } else {
        local_7 = false;
    }
    bool _e236 = local_7;
    if (_e236) {
        local_8 = (height_1 > (2.0 * eta_1));
    } else {
        local_8 = false;
    }
    bool _e243 = local_8;
    if (_e243) {
        uint id = (((volume * ray_2.sign_) < 0.0) ? words_a.w : words_b.w);
        float _e251 = high_3;
        float _e253 = first.high;
        if ((_e251 < _e253)) {
            float _e257 = first.others;
            float _e259 = first.low;
            first.others = min(_e257, _e259);
            first.id = id;
            float _e263 = low_3;
            first.low = _e263;
            float _e265 = high_3;
            first.high = _e265;
        } else {
            float _e268 = first.others;
            float _e269 = low_3;
            first.others = min(_e268, _e269);
        }
    } else {
        float _e273 = first.others;
        float _e274 = low_3;
        first.others = min(_e273, _e274);
    }
    First _e276 = first;
    return _e276;
}

uint first_met(uint at_2) {
    First first_1 = First(4294967295u, 1000000000.0, 1000000000.0, 1000000000.0);
    uint stack[48] = uint[48](0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u);
    uint count = 1u;
    uint turns = 0u;
    uint k = 0u;
    Ray _e1 = ray_of(at_2);
    if (!((_e1.end > 0.0))) {
        return DOUBTFUL;
    }
    uint _e10 = _group_1_binding_32_cs[1].z;
    float tie = uintBitsToFloat(_e10);
    stack[0] = 0u;
    while(true) {
        uint _e25 = count;
        if ((_e25 > 0u)) {
        } else {
            break;
        }
        {
            uint _e28 = count;
            count = (_e28 - 1u);
            uint _e31 = turns;
            turns = (_e31 + 1u);
            uint _e34 = count;
            uint node = stack[min(_e34, 47u)];
            uvec4 center_1 = _group_1_binding_30_cs[(2u * node)];
            uvec4 half_1 = _group_1_binding_30_cs[((2u * node) + 1u)];
            float _e56 = first_1.high;
            bool _e58 = touches(_e1, uintBitsToFloat(center_1.xyz), uintBitsToFloat(half_1.xyz), (_e56 + tie));
            if (!(_e58)) {
                continue;
            }
            uint _e60 = turns;
            turns = (_e60 + half_1.w);
            uint _e63 = turns;
            if ((_e63 > MOST_TURNS)) {
                return DOUBTFUL;
            }
            if ((half_1.w > 0u)) {
                k = 0u;
                bool loop_init = true;
                while(true) {
                    if (!loop_init) {
                        uint _e80 = k;
                        k = (_e80 + 1u);
                    }
                    loop_init = false;
                    uint _e72 = k;
                    if ((_e72 < half_1.w)) {
                    } else {
                        break;
                    }
                    {
                        uint _e76 = k;
                        First _e78 = first_1;
                        First _e79 = meet(_e1, (center_1.w + _e76), _e78);
                        first_1 = _e79;
                    }
                }
            } else {
                if ((center_1.w > 0u)) {
                    uint _e86 = count;
                    if (((_e86 + 2u) > STACK)) {
                        return DOUBTFUL;
                    }
                    uvec4 _e99 = _group_1_binding_30_cs[((2u * center_1.w) + 2u)];
                    uvec4 _e107 = _group_1_binding_30_cs[(2u * center_1.w)];
                    vec3 ahead = (uintBitsToFloat(_e99.xyz) - uintBitsToFloat(_e107.xyz));
                    uint nearer = ((dot(ahead, _e1.way) < 0.0) ? 1u : 0u);
                    uint _e118 = count;
                    stack[min(_e118, 47u)] = ((center_1.w + 1u) - nearer);
                    uint _e126 = count;
                    stack[min((_e126 + 1u), 47u)] = (center_1.w + nearer);
                    uint _e134 = count;
                    count = (_e134 + 2u);
                }
            }
        }
    }
    uint _e138 = first_1.id;
    if ((_e138 == NOTHING)) {
        float _e144 = first_1.others;
        return ((_e144 == NEVER) ? NOTHING : DOUBTFUL);
    }
    uint _e150 = first_1.id;
    float _e152 = first_1.others;
    float _e154 = first_1.high;
    return ((_e152 > (_e154 + tie)) ? _e150 : DOUBTFUL);
}

void main() {
    uvec3 thread = gl_GlobalInvocationID;
    uint _e5 = _group_1_binding_32_cs[1].y;
    if ((thread.x < _e5)) {
        uint _e11 = first_met(thread.x);
        _group_1_binding_33_cs[thread.x] = _e11;
        return;
    } else {
        return;
    }
}

