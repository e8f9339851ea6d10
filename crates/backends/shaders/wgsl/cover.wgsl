// Draws the triangles of a row's entries alone, and adds the weight of those pixels that show something else. With the
// visible weight, that is the covered weight. The positions are those of the render stage, to the bit.

@group(1) @binding(11) var items: texture_2d_array<u32>;
@group(1) @binding(12) var<storage, read> weights: array<u32>;
@group(1) @binding(15) var<storage, read> vertices: array<Vertex>;
@group(1) @binding(16) var<storage, read> indices: array<u32>;
@group(1) @binding(17) var<storage, read> triangle_of_patch: array<u32>;
@group(1) @binding(18) var<storage, read> entries: array<u32>;
@group(1) @binding(22) var<storage, read_write> hidden: array<atomic<u32>>;

struct Corner {
    @builtin(position) @invariant position: vec4<f32>,
    @location(0) @interpolate(flat) entry_patch: vec2<u32>,
}

@vertex
fn cover(@builtin(vertex_index) index: u32) -> Corner {
    let entry = view.layer * settings.capacity + index / 3u;
    let id = entries[2u * entry];
    let c = vertices[indices[3u * triangle_of_patch[id] + index % 3u]];
    let high = vec3<f32>(c.high_x, c.high_y, c.high_z);
    let low = vec3<f32>(c.low_x, c.low_y, c.low_z);
    return Corner(clip_position(view, high, low), vec2<u32>(entry, id));
}

@fragment
fn add_hidden(
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) entry_patch: vec2<u32>,
) {
    let at = vec2<i32>(position.xy);
    if (textureLoad(items, at, i32(view.layer), 0).x != entry_patch.y) {
        atomicAdd(&hidden[entry_patch.x], weights[u32(at.y) * settings.resolution + u32(at.x)]);
    }
}
