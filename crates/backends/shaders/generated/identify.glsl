#version 450 core
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
    uint unused;
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
struct Corner {
    vec4 position;
    uvec2 patches;
};
struct Seen {
    uint id;
    float depth;
};
const float BACK = 0.9999981;

layout(std140, binding = 1) uniform Settings_block_0Fragment { Settings _group_1_binding_1_fs; };

layout(location = 0) flat in uvec2 _vs2fs_location0;
layout(location = 0) out uint _fs2p_location0;

vec3 relative(View v, vec3 high_1, vec3 low_1) {
    return ((high_1 - v.eye_high) + (low_1 - v.eye_low));
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

vec4 clip_position(View v_3, vec3 high_2, vec3 low_2) {
    vec3 _e3 = relative(v_3, high_2, low_2);
    vec3 _e4 = in_frame(v_3, _e3);
    vec3 _e5 = on_face(v_3, _e4);
    return vec4(_e5.x, _e5.y, v_3.near, _e5.z);
}

Seen seen(bool front_4, uvec2 patches_6, float depth) {
    uint id = (front_4 ? patches_6.x : patches_6.y);
    uint _e10 = _group_1_binding_1_fs.patch_count;
    return Seen(id, ((id == _e10) ? (depth * BACK) : depth));
}

Seen seen_side(bool front_5, uvec2 patches_7, float depth_1) {
    Seen _e3 = seen(front_5, patches_7, depth_1);
    uint _e6 = _group_1_binding_1_fs.patch_count;
    uint side = ((_e6 + 2u) + patches_7.x);
    uint _e15 = _group_1_binding_1_fs.patch_count;
    return Seen(((_e3.id == _e15) ? side : _e3.id), _e3.depth);
}

void main() {
    vec4 position = gl_FragCoord;
    bool front = gl_FrontFacing;
    uvec2 patches_1 = _vs2fs_location0;
    Seen _e4 = seen(front, patches_1, position.z);
    _fs2p_location0 = _e4.id;
    gl_FragDepth = _e4.depth;
    return;
}

