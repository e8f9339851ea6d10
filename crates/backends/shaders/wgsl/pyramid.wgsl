// The farthest depths of 4 × 4 and of 16 × 16 pixels of a hemicube's atlas, in that order. One workgroup for 16 × 16 pixels.

@group(1) @binding(4) var depths: texture_2d_array<f32>;
@group(1) @binding(5) var<storage, read_write> pyramid: array<f32>;

var<workgroup> tiles: array<f32, 16>;

@compute @workgroup_size(4, 4)
fn pyramid_of(
    @builtin(local_invocation_index) local: u32,
    @builtin(global_invocation_id) tile: vec3<u32>,
    @builtin(workgroup_id) group: vec3<u32>,
) {
    let layer = view.layer + tile.z;
    let corner = vec2<i32>(tile.xy * 4u);
    var farthest = 1.0;
    for (var y = 0; y < 4; y++) {
        for (var x = 0; x < 4; x++) {
            farthest = min(farthest, textureLoad(depths, corner + vec2<i32>(x, y), i32(layer), 0).x);
        }
    }
    let base = layer * settings.pyramid_stride;
    let across = settings.resolution / 4u;
    pyramid[base + tile.y * across + tile.x] = farthest;
    tiles[local] = farthest;
    workgroupBarrier();
    if (local == 0u) {
        for (var i = 1u; i < 16u; i++) {
            farthest = min(farthest, tiles[i]);
        }
        pyramid[base + 3u * across * across + group.y * (across / 4u) + group.x] = farthest;
    }
}
