// Marks sub-pixel patches: in front at their centroid's pixel although no pixel shows them. If one covers a pixel
// centre after all, the cover stage finds it by the same rasteriser, and the host drops it. One thread a triangle.

@group(1) @binding(3) var<storage, read> chunks: array<Chunk>;
@group(1) @binding(4) var depths: texture_2d_array<f32>;
@group(1) @binding(9) var<storage, read> drawn: array<u32>;
@group(1) @binding(11) var items: texture_2d_array<u32>;
@group(1) @binding(14) var<storage, read_write> touched: array<atomic<u32>>;
@group(1) @binding(15) var<storage, read> vertices: array<Vertex>;
@group(1) @binding(16) var<storage, read> indices: array<u32>;
@group(1) @binding(17) var<storage, read> triangle_of_patch: array<u32>;
// Of each triangle, in pairs of f32: six words. Most triangles are found hidden by these alone.
@group(1) @binding(24) var<storage, read> centroids: array<f32>;
// Depths in a buffer: [layer][pixel].
@group(1) @binding(25) var<storage, read> depth_copy: array<f32>;

const NOBODY: u32 = 0xffffffffu;

struct Triangle {
    // Its first corner, and the vectors to the others. Differences are taken before the eye is subtracted and before
    // the turn: f32 could not otherwise tell small triangles of one surface from one behind the other.
    corner: vec3<f32>,
    edges: array<vec3<f32>, 2>,
    // Across it, to the front.
    normal: vec3<f32>,
    front: u32,
    back: u32,
}

fn turned(v: View, d: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot(v.tangent, d), dot(v.bitangent, d), dot(v.normal, d));
}

fn triangle(v: View, index: u32) -> Triangle {
    let a = vertices[indices[3u * index]];
    let b = vertices[indices[3u * index + 1u]];
    let c = vertices[indices[3u * index + 2u]];
    let high = vec3<f32>(a.high_x, a.high_y, a.high_z);
    let low = vec3<f32>(a.low_x, a.low_y, a.low_z);
    let to_b = (vec3<f32>(b.high_x, b.high_y, b.high_z) - high) + (vec3<f32>(b.low_x, b.low_y, b.low_z) - low);
    let to_c = (vec3<f32>(c.high_x, c.high_y, c.high_z) - high) + (vec3<f32>(c.low_x, c.low_y, c.low_z) - low);
    let edges = array<vec3<f32>, 2>(turned(v, to_b), turned(v, to_c));
    return Triangle(
        in_frame(v, relative(v, high, low)),
        edges,
        cross(edges[0], edges[1]),
        a.front,
        a.back,
    );
}

// 1 / w of a patch in a direction of the frame with w = 1, or 0 if the direction misses it.
fn inverse_there(v: View, patch_id: u32, direction: vec3<f32>) -> f32 {
    let t = triangle(v, triangle_of_patch[patch_id]);
    let inverse = dot(t.normal, direction) / dot(t.normal, t.corner);
    if (!(inverse > 0.0)) {
        return 0.0;
    }
    let p = direction / inverse - t.corner;
    let along_b = dot(cross(p, t.edges[1]), t.normal);
    let along_c = dot(cross(t.edges[0], p), t.normal);
    if (along_b < 0.0 || along_c < 0.0 || along_b + along_c > dot(t.normal, t.normal)) {
        return 0.0;
    }
    return inverse;
}

// A triangle's centroid on the hemicube.
struct Place {
    // Its pixel of the atlas.
    at: vec2<u32>,
    face: u32,
    // 1 / w; 0 in the emitter's plane.
    inverse: f32,
    // Its direction, with w = 1.
    direction: vec3<f32>,
}

fn place(base: u32, index: u32) -> Place {
    let high = vec3<f32>(centroids[6u * index], centroids[6u * index + 1u], centroids[6u * index + 2u]);
    let low = vec3<f32>(centroids[6u * index + 3u], centroids[6u * index + 4u], centroids[6u * index + 5u]);
    let centroid = in_frame(views[base], relative(views[base], high, low));
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
    let inverse = select(1.0 / c.z, 0.0, centroid.z <= views[base].tolerance);
    let extent = vec2<f32>(f32(settings.resolution), f32(v.rows));
    let pixel = vec2<u32>(clamp((c.xy * inverse * 0.5 + 0.5) * extent, vec2<f32>(0.0), extent - 1.0));
    let at = pixel + vec2<u32>(0u, v.first_row);
    return Place(at, face, inverse, centroid * inverse);
}

// The patch of a triangle in front at the centroid and not in the row yet, or `NOBODY`. Neighbours in the same surface
// must not hide it, but would if depths at the pixel's centre were compared. If the visible patch reaches the centroid,
// its depth there decides; beyond a silhouette, about equal nearness is enough.
fn in_front(base: u32, index: u32, p: Place, depth: f32) -> u32 {
    let v = views[base + p.face];
    if (v.near * p.inverse < depth / (1.0 + settings.tiny_slack)) {
        return NOBODY;
    }
    let t = triangle(v, index);
    let behind = dot(t.normal, t.corner);
    let id = select(t.back, t.front, behind < 0.0);
    if (behind == 0.0 || id >= settings.patch_count || t.front == v.emitter || t.back == v.emitter) {
        return NOBODY;
    }
    let word = atomicLoad(&touched[v.layer * settings.word_count + id / 32u]);
    if ((word >> (id % 32u) & 1u) != 0u) {
        return NOBODY;
    }
    let shown = textureLoad(items, vec2<i32>(p.at), i32(v.layer), 0).x;
    if (shown < settings.patch_count && p.inverse < inverse_there(v, shown, p.direction) * (1.0 - 1e-5)) {
        return NOBODY;
    }
    return id;
}

fn mark(layer: u32, id: u32) {
    if (id != NOBODY) {
        atomicOr(&touched[layer * settings.word_count + id / 32u], 1u << (id % 32u));
    }
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
        let p = place(base, first + i);
        if (p.inverse > 0.0) {
            mark(layer, in_front(base, first + i, p, textureLoad(depths, vec2<i32>(p.at), i32(layer), 0).x));
        }
    }
}

// All triangles, with the depths of `keep_tiles`. Groups: any number, layers.
@compute @workgroup_size(64)
fn tiny_of_all(@builtin(global_invocation_id) thread: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let base = (view.slot + thread.y) * 5u;
    let layer = views[base].layer;
    let n = settings.resolution;
    for (var i = thread.x; i < settings.triangle_count; i += groups.x * 64u) {
        let p = place(base, i);
        if (p.inverse > 0.0) {
            mark(layer, in_front(base, i, p, depth_copy[(layer * 3u * n + p.at.y) * n + p.at.x]));
        }
    }
}
