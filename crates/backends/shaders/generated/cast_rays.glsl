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
    uvec4 first_2 = _group_1_binding_32_cs[(2u + (2u * at))];
    uvec4 _e14 = _group_1_binding_32_cs[(3u + (2u * at))];
    vec4 second = uintBitsToFloat(_e14);
    uint bits = _group_1_binding_32_cs[(3u + (2u * at))].z;
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
    float low_3 = 0.0;
    float high_3 = 0.0;
    bool local_2 = false;
    bool local_3 = false;
    bool local_4 = false;
    bool local_5 = false;
    bool local_6 = false;
    first = before;
    uint emitter = _group_1_binding_32_cs[1].x;
    uvec4 words_a = _group_1_binding_31_cs[(3u * at_1)];
    uvec4 words_b = _group_1_binding_31_cs[((3u * at_1) + 1u)];
    uvec4 words_c = _group_1_binding_31_cs[((3u * at_1) + 2u)];
    if (!((words_a.w == emitter))) {
        local = (words_b.w == emitter);
    } else {
        local = true;
    }
    bool _e35 = local;
    if (_e35) {
        First _e36 = first;
        return _e36;
    }
    vec3 a = (uintBitsToFloat(words_a.xyz) - ray_2.start);
    vec3 b = (uintBitsToFloat(words_b.xyz) - ray_2.start);
    vec3 c = (uintBitsToFloat(words_c.xyz) - ray_2.start);
    float _e50 = largest(abs(a));
    float _e52 = largest(abs(b));
    float _e54 = largest(abs(c));
    float far = max(_e50, max(_e52, _e54));
    float eta_1 = (SLACK * (1.0 + far));
    uvec4 _e63 = _group_1_binding_32_cs[0];
    vec4 plane_2 = uintBitsToFloat(_e63);
    float _e72 = largest(vec3(dot(plane_2.xyz, a), dot(plane_2.xyz, b), dot(plane_2.xyz, c)));
    float height_1 = ((_e72 + ray_2.height) - plane_2.w);
    if ((height_1 < (-2.0 * eta_1))) {
        First _e80 = first;
        return _e80;
    }
    vec3 _e82 = turned(a, ray_2.axis);
    vec3 _e84 = turned(b, ray_2.axis);
    vec3 _e86 = turned(c, ray_2.axis);
    vec2 pa = (_e82.xy - (ray_2.shear * _e82.z));
    vec2 pb = (_e84.xy - (ray_2.shear * _e84.z));
    vec2 pc = (_e86.xy - (ray_2.shear * _e86.z));
    float _e102 = cross_of(pb, pc);
    float _e103 = cross_of(pc, pa);
    float _e104 = cross_of(pa, pb);
    vec3 sides = vec3(_e102, _e103, _e104);
    float _e106 = error_of(pb, pc, eta_1);
    float _e107 = error_of(pc, pa, eta_1);
    float _e108 = error_of(pa, pb, eta_1);
    vec3 errors = vec3(_e106, _e107, _e108);
    vec3 over = (sides - errors);
    vec3 under = (sides + errors);
    float _e112 = largest(over);
    if ((_e112 > 0.0)) {
        float _e117 = smallest(under);
        local_1 = (_e117 < 0.0);
    } else {
        local_1 = false;
    }
    bool _e121 = local_1;
    if (_e121) {
        First _e122 = first;
        return _e122;
    }
    vec3 depths = (ray_2.sign_ * vec3(_e82.z, _e84.z, _e86.z));
    float _e129 = smallest(depths);
    float _e130 = largest(depths);
    low_3 = (_e129 - (2.0 * eta_1));
    high_3 = (_e130 + (2.0 * eta_1));
    float volume = ((sides.x + sides.y) + sides.z);
    float error_1 = ((errors.x + errors.y) + errors.z);
    if ((abs(volume) > (2.0 * error_1))) {
        float depth_1 = (_e129 + (dot(sides, (depths - vec3(_e129))) / volume));
        float off = ((((2.0 * error_1) * (_e130 - _e129)) / (abs(volume) - error_1)) + (2.0 * eta_1));
        float _e168 = low_3;
        low_3 = max(_e168, (depth_1 - off));
        float _e171 = high_3;
        high_3 = min(_e171, (depth_1 + off));
    }
    float _e174 = high_3;
    if (!((_e174 < 0.0))) {
        float _e180 = low_3;
        local_2 = (_e180 > (ray_2.end * 1.000001));
    } else {
        local_2 = true;
    }
    bool _e186 = local_2;
    if (_e186) {
        First _e187 = first;
        return _e187;
    }
    float _e188 = smallest(over);
    if (!((_e188 > 0.0))) {
        float _e194 = largest(under);
        local_3 = (_e194 < 0.0);
    } else {
        local_3 = true;
    }
    bool is_within = local_3;
    float _e199 = low_3;
    if ((_e199 > 0.0)) {
        float _e204 = high_3;
        local_4 = (_e204 < (ray_2.end * 0.999999));
    } else {
        local_4 = false;
    }
    bool is_between = local_4;
    if (is_within) {
        local_5 = is_between;
    } else {
        local_5 = false;
    }
    bool _e214 = local_5;
    if (_e214) {
        local_6 = (height_1 > (2.0 * eta_1));
    } else {
        local_6 = false;
    }
    bool _e221 = local_6;
    if (_e221) {
        uint id = (((volume * ray_2.sign_) < 0.0) ? words_a.w : words_b.w);
        float _e229 = high_3;
        float _e231 = first.high;
        if ((_e229 < _e231)) {
            float _e235 = first.others;
            float _e237 = first.low;
            first.others = min(_e235, _e237);
            first.id = id;
            float _e241 = low_3;
            first.low = _e241;
            float _e243 = high_3;
            first.high = _e243;
        } else {
            float _e246 = first.others;
            float _e247 = low_3;
            first.others = min(_e246, _e247);
        }
    } else {
        float _e251 = first.others;
        float _e252 = low_3;
        first.others = min(_e251, _e252);
    }
    First _e254 = first;
    return _e254;
}

uint first_met(uint at_2) {
    First first_1 = First(4294967295u, 1000000000.0, 1000000000.0, 1000000000.0);
    uint stack[48] = uint[48](0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u);
    uint count = 1u;
    uint k = 0u;
    Ray _e1 = ray_of(at_2);
    if (!((_e1.end > 0.0))) {
        return DOUBTFUL;
    }
    uint _e10 = _group_1_binding_32_cs[1].z;
    float tie = uintBitsToFloat(_e10);
    stack[0] = 0u;
    while(true) {
        uint _e23 = count;
        if ((_e23 > 0u)) {
        } else {
            break;
        }
        {
            uint _e26 = count;
            count = (_e26 - 1u);
            uint _e29 = count;
            uint node = stack[min(_e29, 47u)];
            uvec4 center_1 = _group_1_binding_30_cs[(2u * node)];
            uvec4 half_1 = _group_1_binding_30_cs[((2u * node) + 1u)];
            float _e51 = first_1.high;
            bool _e53 = touches(_e1, uintBitsToFloat(center_1.xyz), uintBitsToFloat(half_1.xyz), (_e51 + tie));
            if (!(_e53)) {
                continue;
            }
            if ((half_1.w > 0u)) {
                k = 0u;
                bool loop_init = true;
                while(true) {
                    if (!loop_init) {
                        uint _e68 = k;
                        k = (_e68 + 1u);
                    }
                    loop_init = false;
                    uint _e60 = k;
                    if ((_e60 < half_1.w)) {
                    } else {
                        break;
                    }
                    {
                        uint _e64 = k;
                        First _e66 = first_1;
                        First _e67 = meet(_e1, (center_1.w + _e64), _e66);
                        first_1 = _e67;
                    }
                }
            } else {
                if ((center_1.w > 0u)) {
                    uint _e74 = count;
                    if (((_e74 + 2u) > STACK)) {
                        return DOUBTFUL;
                    }
                    uvec4 _e87 = _group_1_binding_30_cs[((2u * center_1.w) + 2u)];
                    uvec4 _e95 = _group_1_binding_30_cs[(2u * center_1.w)];
                    vec3 ahead = (uintBitsToFloat(_e87.xyz) - uintBitsToFloat(_e95.xyz));
                    uint nearer = ((dot(ahead, _e1.way) < 0.0) ? 1u : 0u);
                    uint _e106 = count;
                    stack[min(_e106, 47u)] = ((center_1.w + 1u) - nearer);
                    uint _e114 = count;
                    stack[min((_e114 + 1u), 47u)] = (center_1.w + nearer);
                    uint _e122 = count;
                    count = (_e122 + 2u);
                }
            }
        }
    }
    uint _e126 = first_1.id;
    if ((_e126 == NOTHING)) {
        float _e132 = first_1.others;
        return ((_e132 == NEVER) ? NOTHING : DOUBTFUL);
    }
    uint _e138 = first_1.id;
    float _e140 = first_1.others;
    float _e142 = first_1.high;
    return ((_e140 > (_e142 + tie)) ? _e138 : DOUBTFUL);
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

