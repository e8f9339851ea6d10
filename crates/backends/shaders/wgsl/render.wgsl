// Draws the ids of nearest patches into the item buffer, and depths. Also depths alone, of likely occluders.

struct Corner {
    @builtin(position) @invariant position: vec4<f32>,
    @location(0) @interpolate(flat) patches: vec2<u32>,
    @location(1) @interpolate(flat) plane: vec4<f32>,
}

@vertex
fn render(
    @location(0) high: vec3<f32>,
    @location(1) low: vec3<f32>,
    @location(2) patches: vec2<u32>,
    @location(3) normal: vec3<f32>,
) -> Corner {
    return Corner(clip_position(view, high, low), patches, plane_on_face(view, high, low, normal));
}

struct Seen {
    @location(0) id: u32,
    @builtin(frag_depth) depth: f32,
}

fn seen(front: bool, patches: vec2<u32>, plane: vec4<f32>, position: vec4<f32>) -> Seen {
    let id = select(patches.y, patches.x, front);
    let depth = depth_of(view, plane, position);
    return Seen(id, select(depth, behind(plane, depth), id == settings.patch_count));
}

@fragment
fn identify(
    @builtin(position) position: vec4<f32>,
    @builtin(front_facing) front: bool,
    @location(0) @interpolate(flat) patches: vec2<u32>,
    @location(1) @interpolate(flat) plane: vec4<f32>,
) -> Seen {
    return seen(front, patches, plane, position);
}

// For hemicubes outside the plane of their emitter: it must be left out by its id.
@fragment
fn identify_others(
    @builtin(position) position: vec4<f32>,
    @builtin(front_facing) front: bool,
    @location(0) @interpolate(flat) patches: vec2<u32>,
    @location(1) @interpolate(flat) plane: vec4<f32>,
) -> Seen {
    if (any(patches == vec2<u32>(view.emitter))) {
        discard;
    }
    return seen(front, patches, plane, position);
}

// For `edges=exact`: a blocking back is named by the patch at its front, so that the settle stage knows its triangle.
// Until rows are summed up, ids are patches, `patch_count + 1` for escaped, and `patch_count + 2` and more for backs.
fn seen_side(front: bool, patches: vec2<u32>, plane: vec4<f32>, position: vec4<f32>) -> Seen {
    let shown = seen(front, patches, plane, position);
    let side = settings.patch_count + 2u + patches.x;
    return Seen(select(shown.id, side, shown.id == settings.patch_count), shown.depth);
}

@fragment
fn identify_sides(
    @builtin(position) position: vec4<f32>,
    @builtin(front_facing) front: bool,
    @location(0) @interpolate(flat) patches: vec2<u32>,
    @location(1) @interpolate(flat) plane: vec4<f32>,
) -> Seen {
    return seen_side(front, patches, plane, position);
}

@fragment
fn identify_other_sides(
    @builtin(position) position: vec4<f32>,
    @builtin(front_facing) front: bool,
    @location(0) @interpolate(flat) patches: vec2<u32>,
    @location(1) @interpolate(flat) plane: vec4<f32>,
) -> Seen {
    if (any(patches == vec2<u32>(view.emitter))) {
        discard;
    }
    return seen_side(front, patches, plane, position);
}

@fragment
fn occlude_others(@location(0) @interpolate(flat) patches: vec2<u32>) {
    if (any(patches == vec2<u32>(view.emitter))) {
        discard;
    }
}
