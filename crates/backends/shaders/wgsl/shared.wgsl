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
    // 1 where clip_y is negated, for an API with rows from above.
    upside_down: u32,
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
    // Runs of chunks: they follow the chunks.
    run_count: u32,
    // The word of the visible weights that numbers the next tile to draw.
    queue: u32,
    // Tiles that a workgroup draws at most.
    tiles_each: u32,
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
    // The unit normal of the triangle owning it.
    normal_x: f32,
    normal_y: f32,
    normal_z: f32,
    unused: f32,
}

// A run of triangles and its box, or a run of chunks, where first_index and index_count number chunks: src/chunks.rs.
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

// The plane of the triangle that owns a corner, as it is on a face. On the image near / w is affine in X and Y, which
// run from -1 to 1 as columns and rows do: xyz are its coefficients of X, Y and 1. w: its relative error, at most.
fn plane_on_face(v: View, high: vec3<f32>, low: vec3<f32>, normal: vec3<f32>) -> vec4<f32> {
    let r = relative(v, high, low);
    let height = normal.x * r.x + normal.y * r.y + normal.z * r.z;
    let n = vec3<f32>(
        v.tangent.x * normal.x + v.tangent.y * normal.y + v.tangent.z * normal.z,
        v.bitangent.x * normal.x + v.bitangent.y * normal.y + v.bitangent.z * normal.z,
        v.normal.x * normal.x + v.normal.y * normal.y + v.normal.z * normal.z,
    );
    let turned = on_face(v, n);
    let q = vec3<f32>(turned.x, select(turned.y, -turned.y, v.upside_down == 1u), turned.z);
    // A side's clip_y is 2 up - forward, and up is (Y + 1) / 2 there.
    let up = 0.25 * (q.y + q.z);
    let coefficients = select(vec3<f32>(q.x, up, up + q.z), q, v.face == 0u);
    // Rounding of r, of the normal, and of three products each.
    let error = (abs(r.x) + abs(r.y) + abs(r.z)) * 2.384185791015625e-7 / abs(height);
    return vec4<f32>(coefficients * (v.near / height), error);
}

// The depth of a triangle's plane at a pixel. Drivers interpolate depths between corners that they have snapped to a
// fraction of a pixel, so that of two triangles of one plane either may be nearer. Of a triangle seen edge-on the
// driver's depth is as good.
fn depth_of(v: View, plane: vec4<f32>, position: vec4<f32>) -> f32 {
    let x = 2.0 * position.x / f32(settings.resolution) - 1.0;
    let y = 2.0 * (position.y - f32(v.first_row)) / f32(v.rows) - 1.0;
    let depth = min(fma(plane.x, x, fma(plane.y, y, plane.z)), 1.0);
    return select(position.z, depth, abs(depth - position.z) <= 0.0625 * position.z);
}

// A blocking back's depth is lowered by this factor, 2^-19, and by the error of its plane: any patch at the same place
// is in front of it, as two houses may share a wall. More would let patches through that are a hair behind.
fn behind(plane: vec4<f32>, depth: f32) -> f32 {
    return depth * (0.9999980926513672 - min(plane.w, 0.0009765625));
}
