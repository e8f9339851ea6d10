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
struct CornerBeyond {
    vec4 position;
    uvec2 patches;
    float height;
    vec4 plane;
};
struct SeenBeyond {
    uint id;
    float depth;
};

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
    float height_1 = (((normal_1.x * _e4.x) + (normal_1.y * _e4.y)) + (normal_1.z * _e4.z));
    vec3 n = vec3((((v_4.tangent.x * normal_1.x) + (v_4.tangent.y * normal_1.y)) + (v_4.tangent.z * normal_1.z)), (((v_4.bitangent.x * normal_1.x) + (v_4.bitangent.y * normal_1.y)) + (v_4.bitangent.z * normal_1.z)), (((v_4.normal.x * normal_1.x) + (v_4.normal.y * normal_1.y)) + (v_4.normal.z * normal_1.z)));
    vec3 _e59 = on_face(v_4, n);
    vec3 q = vec3(_e59.x, ((v_4.upside_down == 1u) ? -(_e59.y) : _e59.y), _e59.z);
    float up = (0.25 * (q.y + q.z));
    vec3 coefficients = ((v_4.face == 0u) ? q : vec3(q.x, up, (up + q.z)));
    float error = ((((abs(_e4.x) + abs(_e4.y)) + abs(_e4.z)) * 2.3841858e-7) / abs(height_1));
    return vec4((coefficients * (v_4.near / height_1)), error);
}

float behind(vec4 plane_2, float depth) {
    return (depth * (0.9999981 - min(plane_2.w, 0.0009765625)));
}

void main() {
    uint corner = uint(gl_VertexID);
    float x_1 = ((corner == 1u) ? 3.0 : -1.0);
    float y_1 = ((corner == 2u) ? 3.0 : -1.0);
    gl_Position = vec4(x_1, y_1, 0.5, 1.0);
    return;
}

