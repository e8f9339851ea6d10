// Draws the ids of what is nearest into the item buffer, and depths. Also depths alone, of what is thought to be in front.

struct Corner {
    @builtin(position) @invariant position: vec4<f32>,
    @location(0) @interpolate(flat) patches: vec2<u32>,
}

@vertex
fn render(
    @location(0) high: vec3<f32>,
    @location(1) low: vec3<f32>,
    @location(2) patches: vec2<u32>,
) -> Corner {
    return Corner(clip_position(view, high, low), patches);
}

@fragment
fn identify(
    @builtin(front_facing) front: bool,
    @location(0) @interpolate(flat) patches: vec2<u32>,
) -> @location(0) u32 {
    return select(patches.y, patches.x, front);
}

// For hemicubes that do not stand in the plane of their emitter, which then must be left out by its id.
@fragment
fn identify_others(
    @builtin(front_facing) front: bool,
    @location(0) @interpolate(flat) patches: vec2<u32>,
) -> @location(0) u32 {
    if (any(patches == vec2<u32>(view.emitter))) {
        discard;
    }
    return select(patches.y, patches.x, front);
}

@fragment
fn occlude_others(@location(0) @interpolate(flat) patches: vec2<u32>) {
    if (any(patches == vec2<u32>(view.emitter))) {
        discard;
    }
}
