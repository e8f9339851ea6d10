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
const uint RUN = 32u;

layout(std140, binding = 0) uniform View_block_0Compute { View _group_0_binding_0_cs; };

layout(std140, binding = 1) uniform Settings_block_1Compute { Settings _group_1_binding_1_cs; };

layout(binding = 11) uniform usampler2DArray _group_1_binding_11_cs;

layout(std430, binding = 12) readonly buffer type_8_block_2Compute { uint _group_1_binding_12_cs[]; };

layout(std430, binding = 13) buffer type_10_block_3Compute { uint _group_1_binding_13_cs[]; };

layout(std430, binding = 14) buffer type_10_block_4Compute { uint _group_1_binding_14_cs[]; };


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

void add(uint layer, uint id, uint weight) {
    bool local = false;
    uint _e6 = _group_1_binding_1_cs.patch_count;
    uint _e12 = atomicAdd(_group_1_binding_13_cs[((layer * (_e6 + 2u)) + id)], weight);
    if ((_e12 == 0u)) {
        uint _e19 = _group_1_binding_1_cs.patch_count;
        local = (id < _e19);
    } else {
        local = false;
    }
    bool _e22 = local;
    if (_e22) {
        uint _e26 = _group_1_binding_1_cs.word_count;
        uint _e36 = atomicOr(_group_1_binding_14_cs[((layer * _e26) + (id / 32u))], (1u << (id % 32u)));
        return;
    } else {
        return;
    }
}

void main() {
    uvec3 run = gl_GlobalInvocationID;
    ivec2 at = ivec2(0);
    uint current = 0u;
    uint sum = 0u;
    uint i = 1u;
    uint n_1 = _group_1_binding_1_cs.resolution;
    uint first = (run.x * RUN);
    if ((first >= ((3u * n_1) * n_1))) {
        return;
    }
    uint _e13 = _group_0_binding_0_cs.layer;
    uint layer_1 = (_e13 + run.y);
    at = ivec2(uvec2((first % n_1), (first / n_1)));
    ivec2 _e22 = at;
    uvec4 _e25 = texelFetch(_group_1_binding_11_cs, ivec3(_e22, int(layer_1)), 0);
    current = _e25.x;
    uint _e30 = _group_1_binding_12_cs[first];
    sum = _e30;
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e70 = i;
            i = (_e70 + 1u);
        }
        loop_init = false;
        uint _e34 = i;
        if ((_e34 < RUN)) {
        } else {
            break;
        }
        {
            int _e38 = at.x;
            at.x = (_e38 + 1);
            int _e42 = at.x;
            if ((_e42 == int(n_1))) {
                int _e46 = at.y;
                at = ivec2(0, (_e46 + 1));
            }
            ivec2 _e52 = at;
            uvec4 _e55 = texelFetch(_group_1_binding_11_cs, ivec3(_e52, int(layer_1)), 0);
            uint id_1 = _e55.x;
            uint _e58 = i;
            uint weight_1 = _group_1_binding_12_cs[(first + _e58)];
            uint _e62 = current;
            if ((id_1 != _e62)) {
                uint _e64 = current;
                uint _e65 = sum;
                add(layer_1, _e64, _e65);
                current = id_1;
                sum = 0u;
            }
            uint _e67 = sum;
            sum = (_e67 + weight_1);
        }
    }
    uint _e72 = current;
    uint _e73 = sum;
    add(layer_1, _e72, _e73);
    return;
}

