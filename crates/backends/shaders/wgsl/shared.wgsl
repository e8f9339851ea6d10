// Declarations of all stages: put before each of them. Binding numbers are the same everywhere, so that one descriptor
// set (or one set of binding points) serves every stage; src/stage.rs names them.

// One face of one hemicube: `View` of src/view.rs.
struct View {
    eye_high: vec3<f32>,
    tolerance: f32,
    eye_low: vec3<f32>,
    slot: u32,
    tangent: vec3<f32>,
    layer: u32,
    bitangent: vec3<f32>,
    face: u32,
    normal: vec3<f32>,
    emitter: u32,
    clip_x: vec3<f32>,
    first_row: u32,
    clip_y: vec3<f32>,
    rows: u32,
    clip_w: vec3<f32>,
    stamp: u32,
    // Distance of the near plane, in half sides of the scene. Depth is near / w, that of an infinite projection,
    // reversed: f32 then has the same relative precision at every distance, for any value of this.
    near: f32,
    // 1 for left-handed axes: behind a mirror.
    mirrored: u32,
    // A portal's plane: normal, and the eye's height above it. Zero without one.
    portal: vec4<f32>,
    unused: array<vec4<u32>, 6>,
}

// Settings of all hemicubes: `settings_words` of src/view.rs.
struct Settings {
    resolution: u32,
    patch_count: u32,
    chunk_count: u32,
    word_count: u32,
    capacity: u32,
    triangle_count: u32,
    pyramid_stride: u32,
    // Factor on a chunk's nearest depth before it is compared with the pyramid.
    slack: f32,
    // Relative distance of a sub-pixel patch behind the depth at its pixel, at most.
    tiny_slack: f32,
    output_entries: u32,
    // Number of earlier groups of hemicubes whose visible chunks are drawn first.
    looks_back: u32,
    unused: u32,
}

// A corner, and the patches of the triangle owning it: src/upload.rs.
struct Vertex {
    high_x: f32,
    high_y: f32,
    high_z: f32,
    low_x: f32,
    low_y: f32,
    low_z: f32,
    front: u32,
    back: u32,
}

// A run of triangles and its box: src/chunks.rs.
struct Chunk {
    center_high: vec3<f32>,
    first_index: u32,
    center_low: vec3<f32>,
    index_count: u32,
    half_sides: vec3<f32>,
    unused: u32,
}

@group(0) @binding(0) var<uniform> view: View;
@group(1) @binding(1) var<uniform> settings: Settings;
@group(1) @binding(2) var<storage, read> views: array<View>;

// A point relative to the eye. Both are sums of two f32: a point near the eye keeps its precision.
fn relative(v: View, high: vec3<f32>, low: vec3<f32>) -> vec3<f32> {
    return (high - v.eye_high) + (low - v.eye_low);
}

// A relative position in the hemicube's frame. A point in the emitter's plane but for rounding is put there exactly: it
// must not be seen on the horizon.
fn in_frame(v: View, r: vec3<f32>) -> vec3<f32> {
    let x = v.tangent.x * r.x + v.tangent.y * r.y + v.tangent.z * r.z;
    let y = v.bitangent.x * r.x + v.bitangent.y * r.y + v.bitangent.z * r.z;
    let z = v.normal.x * r.x + v.normal.y * r.y + v.normal.z * r.z;
    let snap = v.tolerance + (abs(x) + abs(y)) * 9.5367431640625e-7;
    return vec3<f32>(x, y, select(z, 0.0, abs(z) <= snap));
}

// A point of the frame on a face. Each row has one or two nonzero entries, all powers of two: it rounds once only.
fn on_face(v: View, p: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        v.clip_x.x * p.x + v.clip_x.y * p.y + v.clip_x.z * p.z,
        v.clip_y.x * p.x + v.clip_y.y * p.y + v.clip_y.z * p.z,
        v.clip_w.x * p.x + v.clip_w.y * p.y + v.clip_w.z * p.z,
    );
}

fn clip_position(v: View, high: vec3<f32>, low: vec3<f32>) -> vec4<f32> {
    let c = on_face(v, in_frame(v, relative(v, high, low)));
    return vec4<f32>(c.x, c.y, v.near, c.z);
}
