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
struct Corner {
    vec4 position;
    uvec2 patches;
    vec4 plane;
};
struct Seen {
    uint id;
    float depth;
};
layout(std140, binding = 0) uniform View_block_0Fragment { View _group_0_binding_0_fs; };

layout(std140, binding = 1) uniform Settings_block_1Fragment { Settings _group_1_binding_1_fs; };

layout(location = 0) flat in uvec2 _vs2fs_location0;
layout(location = 1) flat in vec4 _vs2fs_location1;
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

vec4 plane_on_face(View v_4, vec3 high_3, vec3 low_3, vec3 normal_1) {
    vec3 _e4 = relative(v_4, high_3, low_3);
    float height = (((normal_1.x * _e4.x) + (normal_1.y * _e4.y)) + (normal_1.z * _e4.z));
    vec3 n = vec3((((v_4.tangent.x * normal_1.x) + (v_4.tangent.y * normal_1.y)) + (v_4.tangent.z * normal_1.z)), (((v_4.bitangent.x * normal_1.x) + (v_4.bitangent.y * normal_1.y)) + (v_4.bitangent.z * normal_1.z)), (((v_4.normal.x * normal_1.x) + (v_4.normal.y * normal_1.y)) + (v_4.normal.z * normal_1.z)));
    vec3 _e59 = on_face(v_4, n);
    vec3 q = vec3(_e59.x, ((v_4.upside_down == 1u) ? -(_e59.y) : _e59.y), _e59.z);
    float up = (0.25 * (q.y + q.z));
    vec3 coefficients = ((v_4.face == 0u) ? q : vec3(q.x, up, (up + q.z)));
    float error = ((((abs(_e4.x) + abs(_e4.y)) + abs(_e4.z)) * 2.3841858e-7) / abs(height));
    return vec4((coefficients * (v_4.near / height)), error);
}

float depth_of(View v_5, vec4 plane_4, vec4 position_4) {
    uint _e8 = _group_1_binding_1_fs.resolution;
    float x_1 = (((2.0 * position_4.x) / float(_e8)) - 1.0);
    float y_1 = (((2.0 * (position_4.y - float(v_5.first_row))) / float(v_5.rows)) - 1.0);
    float depth_1 = min(fma(plane_4.x, x_1, fma(plane_4.y, y_1, plane_4.z)), 1.0);
    return ((abs((depth_1 - position_4.z)) <= (0.0625 * position_4.z)) ? depth_1 : position_4.z);
}

float behind(vec4 plane_5, float depth) {
    return (depth * (0.9999981 - min(plane_5.w, 0.0009765625)));
}

Seen seen(bool front_4, uvec2 patches_6, vec4 plane_6, vec4 position_5) {
    uint id = (front_4 ? patches_6.x : patches_6.y);
    View _e8 = _group_0_binding_0_fs;
    float _e9 = depth_of(_e8, plane_6, position_5);
    float _e10 = behind(plane_6, _e9);
    uint _e13 = _group_1_binding_1_fs.patch_count;
    return Seen(id, ((id == _e13) ? _e10 : _e9));
}

Seen seen_side(bool front_5, uvec2 patches_7, vec4 plane_7, vec4 position_6) {
    Seen _e4 = seen(front_5, patches_7, plane_7, position_6);
    uint _e7 = _group_1_binding_1_fs.patch_count;
    uint side = ((_e7 + 2u) + patches_7.x);
    uint _e16 = _group_1_binding_1_fs.patch_count;
    return Seen(((_e4.id == _e16) ? side : _e4.id), _e4.depth);
}

void main() {
    vec4 position_2 = gl_FragCoord;
    bool front_2 = gl_FrontFacing;
    uvec2 patches_3 = _vs2fs_location0;
    vec4 plane_2 = _vs2fs_location1;
    Seen _e4 = seen_side(front_2, patches_3, plane_2, position_2);
    _fs2p_location0 = _e4.id;
    gl_FragDepth = _e4.depth;
    return;
}

