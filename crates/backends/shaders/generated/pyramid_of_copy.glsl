#version 450 core
#extension GL_ARB_compute_shader : require
#extension GL_ARB_shader_storage_buffer_object : require
layout(local_size_x = 4, local_size_y = 4, local_size_z = 1) in;

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

layout(std430, binding = 5) buffer type_8_block_2Compute { float _group_1_binding_5_cs[]; };

layout(std430, binding = 25) readonly buffer type_8_block_3Compute { float _group_1_binding_25_cs[]; };

shared float tiles[16];


vec3 relative(View v, vec3 high, vec3 low) {
    return ((high - v.eye_high) + (low - v.eye_low));
}

vec3 in_frame(View v_1, vec3 r) {
    float x_1 = (((v_1.tangent.x * r.x) + (v_1.tangent.y * r.y)) + (v_1.tangent.z * r.z));
    float y_2 = (((v_1.bitangent.x * r.x) + (v_1.bitangent.y * r.y)) + (v_1.bitangent.z * r.z));
    float z = (((v_1.normal.x * r.x) + (v_1.normal.y * r.y)) + (v_1.normal.z * r.z));
    float snap = (v_1.tolerance + ((abs(x_1) + abs(y_2)) * 9.536743e-7));
    return vec3(x_1, y_2, ((abs(z) <= snap) ? 0.0 : z));
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
    float y_3 = (((2.0 * (position.y - float(v_5.first_row))) / float(v_5.rows)) - 1.0);
    float depth_1 = min(fma(plane.x, x_2, fma(plane.y, y_3, plane.z)), 1.0);
    return ((abs((depth_1 - position.z)) <= (0.0625 * position.z)) ? depth_1 : position.z);
}

float behind(vec4 plane_1, float depth) {
    return (depth * (0.9999981 - min(plane_1.w, 0.0009765625)));
}

void store(uint local_2, uvec3 tile_2, uvec3 group_2, float farthest_of_tile) {
    float farthest_2 = 0.0;
    uint i = 1u;
    uint _e6 = _group_0_binding_0_cs.layer;
    uint _e11 = _group_1_binding_1_cs.pyramid_stride;
    uint base = ((_e6 + tile_2.z) * _e11);
    uint _e15 = _group_1_binding_1_cs.resolution;
    uint across = (_e15 / 4u);
    _group_1_binding_5_cs[((base + (tile_2.y * across)) + tile_2.x)] = farthest_of_tile;
    tiles[local_2] = farthest_of_tile;
    memoryBarrierShared();
    barrier();
    if ((local_2 == 0u)) {
        farthest_2 = farthest_of_tile;
        bool loop_init = true;
        while(true) {
            if (!loop_init) {
                uint _e42 = i;
                i = (_e42 + 1u);
            }
            loop_init = false;
            uint _e32 = i;
            if ((_e32 < 16u)) {
            } else {
                break;
            }
            {
                float _e35 = farthest_2;
                uint _e37 = i;
                float _e39 = tiles[_e37];
                farthest_2 = min(_e35, _e39);
            }
        }
        float _e57 = farthest_2;
        _group_1_binding_5_cs[(((base + ((3u * across) * across)) + (group_2.y * (across / 4u))) + group_2.x)] = _e57;
        return;
    } else {
        return;
    }
}

void main() {
    uint local_1 = gl_LocalInvocationIndex;
    uvec3 tile_1 = gl_GlobalInvocationID;
    uvec3 group_1 = gl_WorkGroupID;
    uint at = 0u;
    float farthest_1 = 1.0;
    int y_1 = 0;
    uint n_1 = _group_1_binding_1_cs.resolution;
    uint _e8 = _group_0_binding_0_cs.layer;
    at = ((((((_e8 + tile_1.z) * 3u) * n_1) + (tile_1.y * 4u)) * n_1) + (tile_1.x * 4u));
    bool loop_init_1 = true;
    while(true) {
        if (!loop_init_1) {
            int _e61 = y_1;
            y_1 = (_e61 + 1);
        }
        loop_init_1 = false;
        int _e28 = y_1;
        if ((_e28 < 4)) {
        } else {
            break;
        }
        {
            uint _e32 = at;
            float _e34 = _group_1_binding_25_cs[_e32];
            uint _e36 = at;
            float _e40 = _group_1_binding_25_cs[(_e36 + 1u)];
            float left = min(_e34, _e40);
            uint _e43 = at;
            float _e47 = _group_1_binding_25_cs[(_e43 + 2u)];
            uint _e49 = at;
            float _e53 = _group_1_binding_25_cs[(_e49 + 3u)];
            float right = min(_e47, _e53);
            float _e55 = farthest_1;
            farthest_1 = min(_e55, min(left, right));
            uint _e58 = at;
            at = (_e58 + n_1);
        }
    }
    float _e63 = farthest_1;
    store(local_1, tile_1, group_1, _e63);
    return;
}

