#version 450 core
#extension GL_ARB_compute_shader : require
#extension GL_ARB_shader_storage_buffer_object : require
layout(local_size_x = 256, local_size_y = 1, local_size_z = 1) in;

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
const uint GROUP = 256u;

layout(std140, binding = 0) uniform View_block_0Compute { View _group_0_binding_0_cs; };

layout(std140, binding = 1) uniform Settings_block_1Compute { Settings _group_1_binding_1_cs; };

layout(std430, binding = 8) buffer type_7_block_2Compute { uint _group_1_binding_8_cs[]; };

layout(std430, binding = 13) buffer type_7_block_3Compute { uint _group_1_binding_13_cs[]; };

layout(std430, binding = 14) buffer type_7_block_4Compute { uint _group_1_binding_14_cs[]; };

layout(std430, binding = 18) buffer type_7_block_5Compute { uint _group_1_binding_18_cs[]; };

layout(std430, binding = 19) readonly buffer type_7_block_6Compute { uint _group_1_binding_19_cs[]; };

layout(std430, binding = 20) buffer type_7_block_7Compute { uint _group_1_binding_20_cs[]; };

layout(std430, binding = 21) buffer type_7_block_8Compute { uint _group_1_binding_21_cs[]; };

layout(std430, binding = 22) buffer type_7_block_9Compute { uint _group_1_binding_22_cs[]; };

shared uint counts[256];


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
    float depth_1 = min(fma(plane.x, x_1, fma(plane.y, y_1, plane.z)), 1.0);
    return ((abs((depth_1 - position.z)) <= (0.0625 * position.z)) ? depth_1 : position.z);
}

float behind(vec4 plane_1, float depth) {
    return (depth * (0.9999981 - min(plane_1.w, 0.0009765625)));
}

void main() {
    uint local = gl_LocalInvocationIndex;
    uvec3 group = gl_WorkGroupID;
    uint count = 0u;
    uint w = 0u;
    uint before = 0u;
    uint i = 0u;
    uint i_1 = 15u;
    uint at = 0u;
    uint w_1 = 0u;
    uint word = 0u;
    uint _e4 = _group_0_binding_0_cs.slot;
    uint slot = (_e4 + group.x);
    uint _e9 = _group_0_binding_0_cs.layer;
    uint layer = (_e9 + group.x);
    uint _e14 = _group_1_binding_1_cs.word_count;
    uint each = (((_e14 + GROUP) - 1u) / GROUP);
    uint _e24 = _group_1_binding_1_cs.word_count;
    uint first = min((local * each), _e24);
    uint _e29 = _group_1_binding_1_cs.word_count;
    uint end = min((first + each), _e29);
    uint _e33 = _group_1_binding_1_cs.word_count;
    uint words = (layer * _e33);
    w = first;
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e49 = w;
            w = (_e49 + 1u);
        }
        loop_init = false;
        uint _e38 = w;
        if ((_e38 < end)) {
        } else {
            break;
        }
        {
            uint _e40 = count;
            uint _e42 = w;
            uint _e45 = _group_1_binding_14_cs[(words + _e42)];
            count = (_e40 + uint(bitCount(_e45)));
        }
    }
    uint _e53 = count;
    counts[local] = _e53;
    memoryBarrierShared();
    barrier();
    i = (local & 4294967280u);
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            uint _e68 = i;
            i = (_e68 + 1u);
        }
        loop_init_1 = false;
        uint _e59 = i;
        if ((_e59 < local)) {
        } else {
            break;
        }
        {
            uint _e61 = before;
            uint _e63 = i;
            uint _e65 = counts[_e63];
            before = (_e61 + _e65);
        }
    }
    memoryBarrierShared();
    barrier();
    if (((local & 15u) == 15u)) {
        uint _e76 = before;
        uint _e77 = count;
        counts[local] = (_e76 + _e77);
    }
    memoryBarrierShared();
    barrier();
    bool loop_init_2 = true;
    while(true) {
        if (!loop_init_2) {
            uint _e91 = i_1;
            i_1 = (_e91 + 16u);
        }
        loop_init_2 = false;
        uint _e81 = i_1;
        if ((_e81 < (local & 4294967280u))) {
        } else {
            break;
        }
        {
            uint _e85 = before;
            uint _e87 = i_1;
            uint _e89 = counts[_e87];
            before = (_e85 + _e89);
        }
    }
    uint _e96 = _group_1_binding_1_cs.patch_count;
    uint weights = (layer * (_e96 + 2u));
    if ((local == 255u)) {
        uint _e102 = before;
        uint _e103 = count;
        uint all_ = (_e102 + _e103);
        _group_1_binding_21_cs[(4u * slot)] = all_;
        uint _e118 = _group_1_binding_1_cs.patch_count;
        uint _e123 = _group_1_binding_13_cs[((weights + _e118) + 1u)];
        _group_1_binding_21_cs[((4u * slot) + 1u)] = _e123;
        uint _e133 = _group_1_binding_1_cs.patch_count;
        uint _e136 = _group_1_binding_13_cs[(weights + _e133)];
        _group_1_binding_21_cs[((4u * slot) + 2u)] = _e136;
        _group_1_binding_21_cs[((4u * slot) + 3u)] = 0u;
        uint _e147 = _group_1_binding_1_cs.patch_count;
        _group_1_binding_13_cs[((weights + _e147) + 1u)] = 0u;
        uint _e156 = _group_1_binding_1_cs.patch_count;
        _group_1_binding_13_cs[(weights + _e156)] = 0u;
        _group_1_binding_20_cs[(4u * layer)] = (3u * all_);
        _group_1_binding_20_cs[((4u * layer) + 1u)] = 1u;
        _group_1_binding_20_cs[((4u * layer) + 2u)] = 0u;
        _group_1_binding_20_cs[((4u * layer) + 3u)] = 0u;
        if ((group.x == 0u)) {
            uint _e193 = _group_1_binding_1_cs.queue;
            _group_1_binding_13_cs[_e193] = 0u;
        }
    }
    uint _e198 = _group_1_binding_1_cs.capacity;
    uint _e200 = before;
    at = ((layer * _e198) + _e200);
    w_1 = first;
    bool loop_init_3 = true;
    while(true) {
        if (!loop_init_3) {
            uint _e270 = w_1;
            w_1 = (_e270 + 1u);
        }
        loop_init_3 = false;
        uint _e204 = w_1;
        if ((_e204 < end)) {
        } else {
            break;
        }
        {
            uint _e207 = w_1;
            uint _e210 = _group_1_binding_14_cs[(words + _e207)];
            word = _e210;
            uint _e212 = word;
            if ((_e212 == 0u)) {
                continue;
            }
            uint _e216 = w_1;
            _group_1_binding_14_cs[(words + _e216)] = 0u;
            while(true) {
                uint _e220 = word;
                if ((_e220 != 0u)) {
                } else {
                    break;
                }
                {
                    uint _e223 = w_1;
                    uint _e226 = word;
                    uint id = ((_e223 * 32u) + uint(findLSB(_e226)));
                    uint _e229 = word;
                    uint _e230 = word;
                    word = (_e229 & (_e230 - 1u));
                    uint _e236 = at;
                    _group_1_binding_18_cs[(2u * _e236)] = id;
                    uint _e241 = at;
                    uint _e249 = _group_1_binding_13_cs[(weights + id)];
                    _group_1_binding_18_cs[((2u * _e241) + 1u)] = _e249;
                    uint _e251 = at;
                    _group_1_binding_22_cs[_e251] = 0u;
                    uint _e254 = at;
                    at = (_e254 + 1u);
                    _group_1_binding_13_cs[(weights + id)] = 0u;
                    uint _e264 = _group_1_binding_19_cs[id];
                    uint _e268 = _group_0_binding_0_cs.stamp;
                    _group_1_binding_8_cs[_e264] = _e268;
                }
            }
        }
    }
    return;
}

