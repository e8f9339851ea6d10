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
    uvec4 unused[8];
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
    uint unused_0_;
    uint unused_1_;
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
};
struct Chunk {
    vec3 center_high;
    uint first_index;
    vec3 center_low;
    uint index_count;
    vec3 half_sides;
    uint unused;
};
const float NEAR = 9.313226e-10;

layout(std140, binding = 0) uniform View_block_0Compute { View _group_0_binding_0_cs; };

layout(std140, binding = 1) uniform Settings_block_1Compute { Settings _group_1_binding_1_cs; };

layout(binding = 4) uniform sampler2DArray _group_1_binding_4_cs;

layout(std430, binding = 5) buffer type_8_block_2Compute { float _group_1_binding_5_cs[]; };

shared float tiles[16];


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

vec3 on_face(View v_2, vec3 p) {
    return vec3((((v_2.clip_x.x * p.x) + (v_2.clip_x.y * p.y)) + (v_2.clip_x.z * p.z)), (((v_2.clip_y.x * p.x) + (v_2.clip_y.y * p.y)) + (v_2.clip_y.z * p.z)), (((v_2.clip_w.x * p.x) + (v_2.clip_w.y * p.y)) + (v_2.clip_w.z * p.z)));
}

vec4 clip_position(View v_3, vec3 high_1, vec3 low_1) {
    vec3 _e3 = relative(v_3, high_1, low_1);
    vec3 _e4 = in_frame(v_3, _e3);
    vec3 _e5 = on_face(v_3, _e4);
    return vec4(_e5.x, _e5.y, NEAR, _e5.z);
}

void main() {
    if (gl_LocalInvocationID == uvec3(0u)) {
        tiles = float[16](0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    }
    memoryBarrierShared();
    barrier();
    uint local = gl_LocalInvocationIndex;
    uvec3 tile = gl_GlobalInvocationID;
    uvec3 group = gl_WorkGroupID;
    float farthest = 1.0;
    int y = 0;
    int x = 0;
    uint i = 1u;
    uint _e5 = _group_0_binding_0_cs.layer;
    uint layer = (_e5 + tile.z);
    ivec2 corner = ivec2((tile.xy * 4u));
    bool loop_init = true;
    while(true) {
        if (!loop_init) {
            int _e39 = y;
            y = (_e39 + 1);
        }
        loop_init = false;
        int _e16 = y;
        if ((_e16 < 4)) {
        } else {
            break;
        }
        {
            x = 0;
            bool loop_init_1 = true;
            while(true) {
                if (!loop_init_1) {
                    int _e36 = x;
                    x = (_e36 + 1);
                }
                loop_init_1 = false;
                int _e21 = x;
                if ((_e21 < 4)) {
                } else {
                    break;
                }
                {
                    float _e24 = farthest;
                    int _e26 = x;
                    int _e27 = y;
                    vec4 _e32 = texelFetch(_group_1_binding_4_cs, ivec3((corner + ivec2(_e26, _e27)), int(layer)), 0);
                    farthest = min(_e24, _e32.x);
                }
            }
        }
    }
    uint _e43 = _group_1_binding_1_cs.pyramid_stride;
    uint base = (layer * _e43);
    uint _e47 = _group_1_binding_1_cs.resolution;
    uint across = (_e47 / 4u);
    float _e57 = farthest;
    _group_1_binding_5_cs[((base + (tile.y * across)) + tile.x)] = _e57;
    float _e60 = farthest;
    tiles[local] = _e60;
    memoryBarrierShared();
    barrier();
    if ((local == 0u)) {
        bool loop_init_2 = true;
        while(true) {
            if (!loop_init_2) {
                uint _e75 = i;
                i = (_e75 + 1u);
            }
            loop_init_2 = false;
            uint _e65 = i;
            if ((_e65 < 16u)) {
            } else {
                break;
            }
            {
                float _e68 = farthest;
                uint _e70 = i;
                float _e72 = tiles[_e70];
                farthest = min(_e68, _e72);
            }
        }
        float _e90 = farthest;
        _group_1_binding_5_cs[(((base + ((3u * across) * across)) + (group.y * (across / 4u))) + group.x)] = _e90;
        return;
    } else {
        return;
    }
}

