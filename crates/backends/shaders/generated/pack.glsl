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
layout(std140, binding = 0) uniform View_block_0Compute { View _group_0_binding_0_cs; };

layout(std140, binding = 1) uniform Settings_block_1Compute { Settings _group_1_binding_1_cs; };

layout(std430, binding = 10) buffer type_7_block_2Compute { uint _group_1_binding_10_cs[]; };

layout(std430, binding = 18) readonly buffer type_7_block_3Compute { uint _group_1_binding_18_cs[]; };

layout(std430, binding = 21) readonly buffer type_7_block_4Compute { uint _group_1_binding_21_cs[]; };

layout(std430, binding = 22) readonly buffer type_7_block_5Compute { uint _group_1_binding_22_cs[]; };

layout(std430, binding = 23) buffer type_7_block_6Compute { uint _group_1_binding_23_cs[]; };


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
    uvec3 groups = gl_NumWorkGroups;
    uint before = 0u;
    uint s = 0u;
    uint i = 0u;
    bool local_1 = false;
    uint _e5 = _group_0_binding_0_cs.slot;
    uint slot = (_e5 + group.y);
    uint _e10 = _group_0_binding_0_cs.layer;
    uint layer = (_e10 + group.y);
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            uint _e28 = s;
            s = (_e28 + 1u);
        }
        loop_init = false;
        uint _e17 = s;
        if ((_e17 < slot)) {
        } else {
            break;
        }
        {
            uint _e19 = before;
            uint _e22 = s;
            uint _e25 = _group_1_binding_21_cs[(4u * _e22)];
            before = (_e19 + _e25);
        }
    }
    uint _e32 = _group_1_binding_1_cs.capacity;
    uint source = (layer * _e32);
    uint count = _group_1_binding_21_cs[(4u * slot)];
    i = ((group.x * 64u) + local);
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            uint _e86 = i;
            i = (_e86 + (groups.x * 64u));
        }
        loop_init_1 = false;
        uint _e44 = i;
        if ((_e44 < count)) {
        } else {
            break;
        }
        {
            uint _e48 = _group_1_binding_1_cs.output_entries;
            uint _e50 = before;
            uint _e51 = i;
            uint target_at = (_e48 + (3u * (_e50 + _e51)));
            uint _e59 = i;
            uint _e63 = _group_1_binding_18_cs[(2u * (source + _e59))];
            _group_1_binding_23_cs[target_at] = _e63;
            uint _e70 = i;
            uint _e76 = _group_1_binding_18_cs[((2u * (source + _e70)) + 1u)];
            _group_1_binding_23_cs[(target_at + 1u)] = _e76;
            uint _e82 = i;
            uint _e85 = _group_1_binding_22_cs[(source + _e82)];
            _group_1_binding_23_cs[(target_at + 2u)] = _e85;
        }
    }
    if ((group.x == 0u)) {
        local_1 = (local < 8u);
    } else {
        local_1 = false;
    }
    bool _e99 = local_1;
    if (_e99) {
        if ((local < 3u)) {
            uint _e112 = _group_1_binding_21_cs[((4u * slot) + local)];
            _group_1_binding_23_cs[((8u * slot) + local)] = _e112;
            return;
        } else {
            uint _e123 = _group_1_binding_10_cs[((8u * layer) + local)];
            _group_1_binding_23_cs[((8u * slot) + local)] = _e123;
            _group_1_binding_10_cs[((8u * layer) + local)] = 0u;
            return;
        }
    } else {
        return;
    }
}

