// Which chunks are drawn on a face, as indirect draws in the chunks' order whatever the scheduling. One workgroup a face
// and hemicube.

@group(1) @binding(3) var<storage, read> chunks: array<Chunk>;
@group(1) @binding(5) var<storage, read> pyramid: array<f32>;
// Five words a draw: index count, instance count, first index, base vertex, first instance.
@group(1) @binding(6) var<storage, read_write> draws: array<u32>;
@group(1) @binding(7) var<storage, read_write> draw_counts: array<u32>;
// In which group of hemicubes something of a chunk was last seen.
@group(1) @binding(8) var<storage, read> seen: array<u32>;
// Whether a chunk was drawn: [layer][face][chunk].
@group(1) @binding(9) var<storage, read_write> drawn: array<u32>;
// Eight words a layer, see `Tally` of src/output.rs.
@group(1) @binding(10) var<storage, read_write> tallies: array<atomic<u32>>;

const GROUP: u32 = 128u;
const WORDS: u32 = GROUP / 32u;
const OUTSIDE: u32 = 0u;
const HIDDEN: u32 = 1u;
const VISIBLE: u32 = 2u;

var<workgroup> chosen: array<atomic<u32>, WORDS>;
var<workgroup> sums: array<atomic<u32>, 4>;

// Where a chunk's box is on a face: the pixels it may touch, and w of its nearest point. All bounds are widened by more than
// the rounding of the corners' positions; `nearest` is 0 where the box comes too close to the eye to be projected.
struct Projected {
    outside: bool,
    nearest: f32,
    low: vec2<f32>,
    high: vec2<f32>,
}

fn project(v: View, chunk: Chunk) -> Projected {
    var p = Projected(true, 0.0, vec2<f32>(3e38), vec2<f32>(-3e38));
    let r = relative(v, chunk.center_high, chunk.center_low);
    let h = chunk.half_sides;
    let columns = mat3x3<f32>(
        vec3<f32>(v.tangent.x, v.bitangent.x, v.normal.x) * h.x,
        vec3<f32>(v.tangent.y, v.bitangent.y, v.normal.y) * h.y,
        vec3<f32>(v.tangent.z, v.bitangent.z, v.normal.z) * h.z,
    );
    let center = vec3<f32>(dot(v.tangent, r), dot(v.bitangent, r), dot(v.normal, r));
    let extent = abs(columns[0]) + abs(columns[1]) + abs(columns[2]);
    // What is snapped to the emitter's plane moves by a part in a million: within the margin.
    let reach = abs(center) + extent;
    let margin = v.tolerance + (reach.x + reach.y + reach.z) * 7.62939453125e-6;
    if (center.z + extent.z <= -margin) {
        return p;
    }
    let c = on_face(v, center);
    let ex = on_face(v, columns[0]);
    let ey = on_face(v, columns[1]);
    let ez = on_face(v, columns[2]);
    // On how many corners each of the five planes has the box outside.
    var out = array<u32, 5>(0u, 0u, 0u, 0u, 0u);
    var nearest = 3e38;
    var low = vec2<f32>(3e38);
    var high = vec2<f32>(-3e38);
    for (var k = 0u; k < 8u; k++) {
        let sx = select(-1.0, 1.0, (k & 1u) != 0u);
        let sy = select(-1.0, 1.0, (k & 2u) != 0u);
        let sz = select(-1.0, 1.0, (k & 4u) != 0u);
        let q = c + sx * ex + sy * ey + sz * ez;
        // Rows of the projection add at most three coordinates.
        out[0] += u32(q.x < -q.z - 4.0 * margin);
        out[1] += u32(q.x > q.z + 4.0 * margin);
        out[2] += u32(q.y < -q.z - 4.0 * margin);
        out[3] += u32(q.y > q.z + 4.0 * margin);
        out[4] += u32(q.z < -margin);
        nearest = min(nearest, q.z);
        let w_low = q.z - margin;
        let w_high = q.z + margin;
        let a = q.xy - 3.0 * margin;
        let b = q.xy + 3.0 * margin;
        low = min(low, a / select(vec2<f32>(w_high), vec2<f32>(w_low), a < vec2<f32>(0.0)));
        high = max(high, b / select(vec2<f32>(w_low), vec2<f32>(w_high), b < vec2<f32>(0.0)));
    }
    if (out[0] == 8u || out[1] == 8u || out[2] == 8u || out[3] == 8u || out[4] == 8u) {
        return p;
    }
    p.outside = false;
    nearest -= margin;
    // Nearer than this, the margin would be more than a part in sixteen of w.
    if (nearest > 16.0 * margin) {
        p.nearest = nearest;
        p.low = low;
        p.high = high;
    }
    return p;
}

fn is_hidden(v: View, p: Projected) -> bool {
    let size = vec2<f32>(f32(settings.resolution), f32(v.rows));
    // Pixels that the box touches, and a little more: corners are snapped to a fraction of a pixel.
    let first = vec2<u32>(clamp((p.low * 0.5 + 0.5) * size - 0.05, vec2<f32>(0.0), size - 1.0));
    let last = vec2<u32>(clamp((p.high * 0.5 + 0.5) * size + 0.05, vec2<f32>(0.0), size - 1.0));
    let bound = NEAR / p.nearest * settings.slack;
    let across = settings.resolution / 4u;
    var base = v.layer * settings.pyramid_stride;
    var shift = 2u;
    var pitch = across;
    let extent = last - first;
    if (max(extent.x, extent.y) >= 24u) {
        base += 3u * across * across;
        shift = 4u;
        pitch = across / 4u;
    }
    let row = vec2<u32>(0u, v.first_row);
    let low_tile = (first + row) >> vec2<u32>(shift);
    let high_tile = (last + row) >> vec2<u32>(shift);
    for (var y = low_tile.y; y <= high_tile.y; y++) {
        for (var x = low_tile.x; x <= high_tile.x; x++) {
            if (pyramid[base + y * pitch + x] <= bound) {
                return false;
            }
        }
    }
    return true;
}

fn outcome(v: View, index: u32, against_depths: bool) -> u32 {
    let p = project(v, chunks[index]);
    if (p.outside) {
        return OUTSIDE;
    }
    if (against_depths && p.nearest > 0.0 && is_hidden(v, p)) {
        return HIDDEN;
    }
    return VISIBLE;
}

// With `only_seen`, only chunks of which the group of hemicubes before saw something are asked.
fn list(local: u32, v: View, only_seen: bool, against_depths: bool) {
    let face = v.layer * 5u + v.face;
    var count = 0u;
    if (local < 4u) {
        atomicStore(&sums[local], 0u);
    }
    for (var start = 0u; start < settings.chunk_count; start += GROUP) {
        if (local < WORDS) {
            atomicStore(&chosen[local], 0u);
        }
        workgroupBarrier();
        let index = start + local;
        var found = OUTSIDE;
        if (index < settings.chunk_count) {
            if (!only_seen || seen[index] + 1u == v.stamp) {
                found = outcome(v, index, against_depths);
            }
            if (!only_seen) {
                drawn[face * settings.chunk_count + index] = u32(found == VISIBLE);
                if (found == OUTSIDE) {
                    atomicAdd(&sums[0], 1u);
                } else if (found == HIDDEN) {
                    atomicAdd(&sums[1], 1u);
                }
            }
            if (found == VISIBLE) {
                atomicOr(&chosen[local / 32u], 1u << (local % 32u));
            }
        }
        workgroupBarrier();
        var before = count;
        for (var w = 0u; w < WORDS; w++) {
            let word = atomicLoad(&chosen[w]);
            let all = countOneBits(word);
            if (w < local / 32u) {
                before += all;
            } else if (w == local / 32u) {
                before += countOneBits(word & ((1u << (local % 32u)) - 1u));
            }
            count += all;
        }
        if (found == VISIBLE) {
            let at = (face * settings.chunk_count + before) * 5u;
            draws[at] = chunks[index].index_count;
            draws[at + 1u] = 1u;
            draws[at + 2u] = chunks[index].first_index;
            draws[at + 3u] = 0u;
            draws[at + 4u] = 0u;
            atomicAdd(&sums[2], chunks[index].index_count / 3u);
        }
        workgroupBarrier();
    }
    if (local == 0u) {
        draw_counts[face] = count;
        let tally = v.layer * 8u;
        if (only_seen) {
            atomicAdd(&tallies[tally + 7u], atomicLoad(&sums[2]));
        } else {
            atomicAdd(&tallies[tally + 3u], settings.chunk_count);
            atomicAdd(&tallies[tally + 4u], atomicLoad(&sums[0]));
            atomicAdd(&tallies[tally + 5u], atomicLoad(&sums[1]));
            atomicAdd(&tallies[tally + 6u], atomicLoad(&sums[2]));
        }
    }
}

// What is drawn first, as depths only.
@compute @workgroup_size(GROUP)
fn cull_seen(@builtin(local_invocation_index) local: u32, @builtin(workgroup_id) group: vec3<u32>) {
    list(local, views[(view.slot + group.y) * 5u + group.x], true, false);
}

// What is not behind that.
@compute @workgroup_size(GROUP)
fn cull_hidden(@builtin(local_invocation_index) local: u32, @builtin(workgroup_id) group: vec3<u32>) {
    list(local, views[(view.slot + group.y) * 5u + group.x], false, true);
}

// What is in view at all.
@compute @workgroup_size(GROUP)
fn cull_outside(@builtin(local_invocation_index) local: u32, @builtin(workgroup_id) group: vec3<u32>) {
    list(local, views[(view.slot + group.y) * 5u + group.x], false, false);
}
