// Adds up the visible weight of each patch. Runs of pixels of one id are added at once: atomics are expensive.

@group(1) @binding(11) var items: texture_2d_array<u32>;
@group(1) @binding(12) var<storage, read> weights: array<u32>;
// Patches, then blocked, then escaped: [layer][patch_count + 2].
@group(1) @binding(13) var<storage, read_write> visible: array<atomic<u32>>;
// A bit for each patch in the row: [layer][word_count].
@group(1) @binding(14) var<storage, read_write> touched: array<atomic<u32>>;

const RUN: u32 = 32u;

fn add(layer: u32, id: u32, weight: u32) {
    let before = atomicAdd(&visible[layer * (settings.patch_count + 2u) + id], weight);
    if (before == 0u && id < settings.patch_count) {
        atomicOr(&touched[layer * settings.word_count + id / 32u], 1u << (id % 32u));
    }
}

@compute @workgroup_size(64)
fn reduce(@builtin(global_invocation_id) run: vec3<u32>) {
    let n = settings.resolution;
    let first = run.x * RUN;
    if (first >= 3u * n * n) {
        return;
    }
    let layer = view.layer + run.y;
    var at = vec2<i32>(vec2<u32>(first % n, first / n));
    var current = textureLoad(items, at, i32(layer), 0).x;
    var sum = weights[first];
    for (var i = 1u; i < RUN; i++) {
        at.x += 1;
        if (at.x == i32(n)) {
            at = vec2<i32>(0, at.y + 1);
        }
        let id = textureLoad(items, at, i32(layer), 0).x;
        let weight = weights[first + i];
        if (id != current) {
            add(layer, current, sum);
            current = id;
            sum = 0u;
        }
        sum += weight;
    }
    add(layer, current, sum);
}
