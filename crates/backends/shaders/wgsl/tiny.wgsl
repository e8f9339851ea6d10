// Notes patches that are in front at their centroid's pixel although no pixel shows them. Whether one covers a pixel centre
// after all is found by the cover stage, which the same rasteriser draws; the host then drops it. One thread a triangle.

@group(1) @binding(3) var<storage, read> chunks: array<Chunk>;
@group(1) @binding(4) var depths: texture_2d_array<f32>;
@group(1) @binding(9) var<storage, read> drawn: array<u32>;
@group(1) @binding(11) var items: texture_2d_array<u32>;
@group(1) @binding(14) var<storage, read_write> touched: array<atomic<u32>>;
@group(1) @binding(15) var<storage, read> vertices: array<Vertex>;
@group(1) @binding(16) var<storage, read> indices: array<u32>;
@group(1) @binding(17) var<storage, read> triangle_of_patch: array<u32>;

struct Triangle {
    corners: array<vec3<f32>, 3>,
    // By how much the eye is behind it, up to a positive factor.
    volume: f32,
    front: u32,
    back: u32,
}

fn triangle(v: View, index: u32) -> Triangle {
    var t: Triangle;
    for (var k = 0u; k < 3u; k++) {
        let c = vertices[indices[3u * index + k]];
        let high = vec3<f32>(c.high_x, c.high_y, c.high_z);
        let low = vec3<f32>(c.low_x, c.low_y, c.low_z);
        t.corners[k] = in_frame(v, relative(v, high, low));
        if (k == 0u) {
            t.front = c.front;
            t.back = c.back;
        }
    }
    t.volume = dot(t.corners[0], cross(t.corners[1], t.corners[2]));
    return t;
}

// 1 / w of a patch in a direction of the frame in which w is 1, or 0 where the direction misses it.
fn inverse_there(v: View, patch_id: u32, direction: vec3<f32>) -> f32 {
    let t = triangle(v, triangle_of_patch[patch_id]);
    let a = dot(cross(t.corners[1], t.corners[2]), direction);
    let b = dot(cross(t.corners[2], t.corners[0]), direction);
    let c = dot(cross(t.corners[0], t.corners[1]), direction);
    if (a * t.volume < 0.0 || b * t.volume < 0.0 || c * t.volume < 0.0 || t.volume == 0.0) {
        return 0.0;
    }
    return max((a + b + c) / t.volume, 0.0);
}

fn is_in_front(base: u32, index: u32) -> bool {
    let frame = views[base];
    let t = triangle(frame, index);
    let id = select(t.back, t.front, t.volume < 0.0);
    if (t.volume == 0.0 || id >= settings.patch_count || t.front == frame.emitter || t.back == frame.emitter) {
        return false;
    }
    let word = atomicLoad(&touched[frame.layer * settings.word_count + id / 32u]);
    if ((word >> (id % 32u) & 1u) != 0u) {
        return false;
    }
    let centroid = (t.corners[0] + t.corners[1] + t.corners[2]) / 3.0;
    if (centroid.z <= frame.tolerance) {
        return false;
    }
    let size = abs(centroid);
    var face = 0u;
    if (size.z < size.x || size.z < size.y) {
        if (size.x >= size.y) {
            face = select(2u, 1u, centroid.x > 0.0);
        } else {
            face = select(4u, 3u, centroid.y > 0.0);
        }
    }
    let v = views[base + face];
    let c = on_face(v, centroid);
    let inverse = 1.0 / c.z;
    let extent = vec2<f32>(f32(settings.resolution), f32(v.rows));
    let pixel = vec2<i32>(clamp((c.xy * inverse * 0.5 + 0.5) * extent, vec2<f32>(0.0), extent - 1.0));
    let at = pixel + vec2<i32>(0, i32(v.first_row));
    let shown = textureLoad(items, at, i32(v.layer), 0).x;
    if (shown > settings.patch_count) {
        return true;
    }
    // Neighbours in the same surface must not hide it, as they would if depths at the pixel's centre were compared: where
    // the patch that is seen reaches the centroid, its depth there decides. Beyond a silhouette, being about as near does.
    let depth = NEAR * inverse;
    if (depth < textureLoad(depths, at, i32(v.layer), 0).x / (1.0 + settings.tiny_slack)) {
        return false;
    }
    if (shown == settings.patch_count) {
        return true;
    }
    return inverse >= inverse_there(v, shown, centroid * inverse) * (1.0 - 1e-5);
}

@compute @workgroup_size(64)
fn tiny(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let base = (view.slot + group.y) * 5u;
    let layer = views[base].layer;
    let chunk = group.x + group.z * 32768u;
    if (chunk >= settings.chunk_count) {
        return;
    }
    var on = 0u;
    for (var face = 0u; face < 5u; face++) {
        on |= drawn[(layer * 5u + face) * settings.chunk_count + chunk];
    }
    if (on == 0u) {
        return;
    }
    let first = chunks[chunk].first_index / 3u;
    let count = chunks[chunk].index_count / 3u;
    for (var i = local; i < count; i += 64u) {
        if (is_in_front(base, first + i)) {
            let c = vertices[indices[3u * (first + i)]];
            let t = triangle(views[base], first + i);
            let id = select(c.back, c.front, t.volume < 0.0);
            atomicOr(&touched[layer * settings.word_count + id / 32u], 1u << (id % 32u));
        }
    }
}
