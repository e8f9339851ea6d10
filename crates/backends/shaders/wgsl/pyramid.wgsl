// The farthest depths of 4 × 4 and of 16 × 16 pixels of a hemicube's atlas, in that order. One workgroup for 16 × 16
// pixels.

@group(1) @binding(4) var depths: texture_2d_array<f32>;
@group(1) @binding(5) var<storage, read_write> pyramid: array<f32>;
// Depths copied to a buffer: [layer][pixel]. Software reads it five times faster than a texture.
@group(1) @binding(25) var<storage, read> depth_copy: array<f32>;

var<workgroup> tiles: array<f32, 16>;

fn store(local: u32, tile: vec3<u32>, group: vec3<u32>, farthest_of_tile: f32) {
    let base = (view.layer + tile.z) * settings.pyramid_stride;
    let across = settings.resolution / 4u;
    pyramid[base + tile.y * across + tile.x] = farthest_of_tile;
    tiles[local] = farthest_of_tile;
    workgroupBarrier();
    if (local == 0u) {
        var farthest = farthest_of_tile;
        for (var i = 1u; i < 16u; i++) {
            farthest = min(farthest, tiles[i]);
        }
        pyramid[base + 3u * across * across + group.y * (across / 4u) + group.x] = farthest;
    }
}

@compute @workgroup_size(4, 4)
fn pyramid_of(
    @builtin(local_invocation_index) local: u32,
    @builtin(global_invocation_id) tile: vec3<u32>,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let corner = vec2<i32>(tile.xy * 4u);
    var farthest = 1.0;
    for (var y = 0; y < 4; y++) {
        for (var x = 0; x < 4; x++) {
            let depth = textureLoad(depths, corner + vec2<i32>(x, y), i32(view.layer + tile.z), 0).x;
            farthest = min(farthest, depth);
        }
    }
    store(local, tile, group, farthest);
}

@compute @workgroup_size(4, 4)
fn pyramid_of_copy(
    @builtin(local_invocation_index) local: u32,
    @builtin(global_invocation_id) tile: vec3<u32>,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let n = settings.resolution;
    var at = ((view.layer + tile.z) * 3u * n + tile.y * 4u) * n + tile.x * 4u;
    var farthest = 1.0;
    for (var y = 0; y < 4; y++) {
        let left = min(depth_copy[at], depth_copy[at + 1u]);
        let right = min(depth_copy[at + 2u], depth_copy[at + 3u]);
        farthest = min(farthest, min(left, right));
        at += n;
    }
    store(local, tile, group, farthest);
}
