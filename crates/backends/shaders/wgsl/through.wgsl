// Draws the ids of nearest patches seen through a portal: what lies before its plane is cut away.

struct CornerBeyond {
    @builtin(position) @invariant position: vec4<f32>,
    @location(0) @interpolate(flat) patches: vec2<u32>,
    // Height above the portal's plane.
    @location(1) height: f32,
    @location(2) @interpolate(flat) plane: vec4<f32>,
}

@vertex
fn through(
    @location(0) high: vec3<f32>,
    @location(1) low: vec3<f32>,
    @location(2) patches: vec2<u32>,
    @location(3) normal: vec3<f32>,
) -> CornerBeyond {
    let r = relative(view, high, low);
    let height = view.portal.x * r.x + view.portal.y * r.y + view.portal.z * r.z + view.portal.w;
    // A point in the plane but for rounding is put there: the portal itself is not seen. The sum of three is at most
    // √3 times the distance: within HEIGHT_SLACK of the contract.
    let snap = view.tolerance + (abs(r.x) + abs(r.y) + abs(r.z)) * 9.5367431640625e-7;
    let beyond = select(height, 0.0, abs(height) <= snap);
    return CornerBeyond(clip_position(view, high, low), patches, beyond, plane_on_face(view, high, low, normal));
}

struct SeenBeyond {
    @location(0) id: u32,
    @builtin(frag_depth) depth: f32,
}

@fragment
fn identify_through(
    @builtin(position) position: vec4<f32>,
    @builtin(front_facing) front: bool,
    @location(0) @interpolate(flat) patches: vec2<u32>,
    @location(1) height: f32,
    @location(2) @interpolate(flat) plane: vec4<f32>,
) -> SeenBeyond {
    if (height <= 0.0) {
        discard;
    }
    let id = select(patches.y, patches.x, front != (view.mirrored == 1u));
    let depth = depth_of(view, plane, position);
    return SeenBeyond(id, select(depth, behind(plane, depth), id == settings.patch_count));
}

@group(1) @binding(25) var<storage, read> first_depths: array<f32>;

@vertex
fn every_pixel(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    // One triangle over the whole image.
    let x = select(-1.0, 3.0, corner == 1u);
    let y = select(-1.0, 3.0, corner == 2u);
    return vec4<f32>(x, y, 0.5, 1.0);
}

@fragment
fn preset_depths(@builtin(position) position: vec4<f32>) -> @builtin(frag_depth) f32 {
    let at = vec2<u32>(position.xy);
    return first_depths[at.y * settings.resolution + at.x];
}
