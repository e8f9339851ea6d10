// Lists the chunks to draw on a face: indirect draws in the chunks' order, for any scheduling. One workgroup a face and
// hemicube.

@group(1) @binding(3) var<storage, read> chunks: array<Chunk>;
@group(1) @binding(5) var<storage, read> pyramid: array<f32>;
// Five words a draw: index count, instance count, first index, base vertex, first instance.
@group(1) @binding(6) var<storage, read_write> draws: array<u32>;
@group(1) @binding(7) var<storage, read_write> draw_counts: array<u32>;
// The stamp of the last group of hemicubes that saw a chunk.
@group(1) @binding(8) var<storage, read> seen: array<u32>;
// 1 for a drawn chunk: [layer][face][chunk].
@group(1) @binding(9) var<storage, read_write> drawn: array<u32>;
// Eight words a layer, see `Tally` of src/output.rs.
@group(1) @binding(10) var<storage, read_write> tallies: array<atomic<u32>>;

// Depths are interpolated: over a triangle their error is some 2⁻²⁰ of the nearest one, at any distance of the pixel.
// This is 2⁻¹⁸, in units of the near plane's distance.
const FAR_ERROR: f32 = 3.814697265625e-6;
const GROUP: u32 = 128u;
const WORDS: u32 = GROUP / 32u;
const OUTSIDE: u32 = 0u;
const HIDDEN: u32 = 1u;
const VISIBLE: u32 = 2u;

var<workgroup> chosen: array<atomic<u32>, WORDS>;
var<workgroup> sums: array<atomic<u32>, 4>;

// A chunk's box on a face: its middle, and the vectors to its sides, with w last. All bounds are widened by `margin`,
// which is more than the rounding of the corners' positions.
struct Projected {
    outside: bool,
    margin: f32,
    middle: vec3<f32>,
    sides: mat3x3<f32>,
    // From the eye to its middle, and half its sides, along the axes of the scene.
    offset: vec3<f32>,
    half: vec3<f32>,
    // At most w of its nearest point; below 0 if the box is too close to the eye for projection.
    nearest: f32,
}

// The half extent of a box with these sides along a direction of a face.
fn reach(sides: mat3x3<f32>, along: vec3<f32>) -> f32 {
    return dot(abs(along * sides), vec3<f32>(1.0));
}

fn project(v: View, chunk: Chunk) -> Projected {
    let r = relative(v, chunk.center_high, chunk.center_low);
    let h = chunk.half_sides;
    let columns = mat3x3<f32>(
        vec3<f32>(v.tangent.x, v.bitangent.x, v.normal.x) * h.x,
        vec3<f32>(v.tangent.y, v.bitangent.y, v.normal.y) * h.y,
        vec3<f32>(v.tangent.z, v.bitangent.z, v.normal.z) * h.z,
    );
    let center = vec3<f32>(dot(v.tangent, r), dot(v.bitangent, r), dot(v.normal, r));
    let extent = abs(columns[0]) + abs(columns[1]) + abs(columns[2]);
    // Points snapped to the emitter's plane move by a part in a million: within the margin.
    let far = abs(center) + extent;
    let margin = v.tolerance + (far.x + far.y + far.z) * 7.62939453125e-6;
    let c = on_face(v, center);
    let sides = mat3x3<f32>(on_face(v, columns[0]), on_face(v, columns[1]), on_face(v, columns[2]));
    // Rows of the projection add at most three coordinates.
    let outside = center.z + extent.z <= -margin
        || c.x + c.z + reach(sides, vec3<f32>(1.0, 0.0, 1.0)) < -4.0 * margin
        || c.z - c.x + reach(sides, vec3<f32>(-1.0, 0.0, 1.0)) < -4.0 * margin
        || c.y + c.z + reach(sides, vec3<f32>(0.0, 1.0, 1.0)) < -4.0 * margin
        || c.z - c.y + reach(sides, vec3<f32>(0.0, -1.0, 1.0)) < -4.0 * margin
        || c.z + reach(sides, vec3<f32>(0.0, 0.0, 1.0)) < -margin;
    let nearest = c.z - reach(sides, vec3<f32>(0.0, 0.0, 1.0)) - margin;
    // Nearer than this, the margin would be more than a part in sixteen of w.
    return Projected(outside, margin, c, sides, r, h + margin, select(-1.0, nearest, nearest > 16.0 * margin));
}

// A ray of a face at (x, y) of its square of ±1 has w = 1 in front of the eye after one step; along each axis of the
// scene, that step is affine in x and y.
struct Steps {
    by_x: vec3<f32>,
    by_y: vec3<f32>,
    middle: vec3<f32>,
    // More than the rounding of any of it.
    margin: vec3<f32>,
}

fn steps(v: View) -> Steps {
    // The inverse of the face's projection; its rows are powers of two, so that nothing rounds.
    let for_x = cross(v.clip_y, v.clip_w);
    let for_y = cross(v.clip_w, v.clip_x);
    let for_w = cross(v.clip_x, v.clip_y);
    let scale = 1.0 / dot(v.clip_x, for_x);
    let x = scale * (for_x.x * v.tangent + for_x.y * v.bitangent + for_x.z * v.normal);
    let y = scale * (for_y.x * v.tangent + for_y.y * v.bitangent + for_y.z * v.normal);
    let w = scale * (for_w.x * v.tangent + for_w.y * v.bitangent + for_w.z * v.normal);
    return Steps(x, y, w, (abs(x) + abs(y) + abs(w)) * 1.9073486328125e-6);
}

// A bound on the depths of a box seen through a square of pixels, rounding included; less than any depth if the box is
// not seen there. The pixels are first to last, widened by the reach of snapped corners.
fn bound_through(v: View, s: Steps, p: Projected, size: vec2<f32>, first: vec2<u32>, last: vec2<u32>) -> f32 {
    let low = (vec2<f32>(first) - 0.05) / size * 2.0 - 1.0;
    let high = (vec2<f32>(last) + 1.05) / size * 2.0 - 1.0;
    let middle = (low + high) * 0.5;
    let half = (high - low) * 0.5;
    // Steps towards the box's middle, axis by axis.
    let towards = select(vec3<f32>(1.0), vec3<f32>(-1.0), p.offset < vec3<f32>(0.0));
    let step = towards * (s.middle + middle.x * s.by_x + middle.y * s.by_y);
    let reach = half.x * abs(s.by_x) + half.y * abs(s.by_y) + s.margin;
    let longest = step + reach;
    let shortest = step - reach;
    // The ends of the box along the axis.
    let begin = abs(p.offset) - p.half;
    let end = abs(p.offset) + p.half;
    var enter = p.nearest;
    var leave = 3e38;
    for (var k = 0u; k < 3u; k++) {
        if (begin[k] > 0.0) {
            if (longest[k] <= 0.0) {
                return -1.0;
            }
            enter = max(enter, begin[k] / longest[k]);
        } else if (longest[k] < 0.0) {
            leave = min(leave, begin[k] / longest[k]);
        }
        if (shortest[k] > 0.0) {
            leave = min(leave, end[k] / shortest[k]);
        }
    }
    if (enter > leave * 1.0000019) {
        return -1.0;
    }
    // The slack is more than the rounding of the divisions.
    return v.near * (settings.slack / enter + FAR_ERROR / p.nearest);
}

fn is_hidden(v: View, p: Projected) -> bool {
    let size = vec2<f32>(f32(settings.resolution), f32(v.rows));
    var low = vec2<f32>(3e38);
    var high = vec2<f32>(-3e38);
    for (var k = 0u; k < 4u; k++) {
        let sx = select(-1.0, 1.0, (k & 1u) != 0u);
        let sy = select(-1.0, 1.0, (k & 2u) != 0u);
        let edge = p.middle + sx * p.sides[0] + sy * p.sides[1];
        for (var sz = -1.0; sz < 2.0; sz += 2.0) {
            let q = edge + sz * p.sides[2];
            let w_low = q.z - p.margin;
            let w_high = q.z + p.margin;
            let a = q.xy - 3.0 * p.margin;
            let b = q.xy + 3.0 * p.margin;
            low = min(low, a / select(vec2<f32>(w_high), vec2<f32>(w_low), a < vec2<f32>(0.0)));
            high = max(high, b / select(vec2<f32>(w_low), vec2<f32>(w_high), b < vec2<f32>(0.0)));
        }
    }
    // Pixels touched by the box, and a little more: corners are snapped to a fraction of a pixel.
    let first = vec2<u32>(clamp((low * 0.5 + 0.5) * size - 0.05, vec2<f32>(0.0), size - 1.0));
    let last = vec2<u32>(clamp((high * 0.5 + 0.5) * size + 0.05, vec2<f32>(0.0), size - 1.0));
    let s = steps(v);
    let bound = settings.slack * v.near / p.nearest;
    let across = settings.resolution / 4u;
    let fine = v.layer * settings.pyramid_stride;
    let coarse = fine + 3u * across * across;
    // Faces begin at multiples of 8 rows: squares are the atlas's, and may reach into the next face.
    let row = vec2<u32>(0u, v.first_row);
    let from_first = first + row;
    let to_last = last + row;
    let low_square = from_first >> vec2<u32>(4u);
    let high_square = to_last >> vec2<u32>(4u);
    for (var y = low_square.y; y <= high_square.y; y++) {
        for (var x = low_square.x; x <= high_square.x; x++) {
            let square = vec2<u32>(x, y) << vec2<u32>(4u);
            let a = max(square, from_first);
            let b = min(square + 15u, to_last);
            // Most squares are decided by the box's nearest point alone.
            let behind = pyramid[coarse + y * (across / 4u) + x];
            if (behind > bound || behind > bound_through(v, s, p, size, a - row, b - row)) {
                continue;
            }
            let low_tile = a >> vec2<u32>(2u);
            let high_tile = b >> vec2<u32>(2u);
            for (var ty = low_tile.y; ty <= high_tile.y; ty++) {
                for (var tx = low_tile.x; tx <= high_tile.x; tx++) {
                    let behind = pyramid[fine + ty * across + tx];
                    if (behind <= bound) {
                        let tile = vec2<u32>(tx, ty) << vec2<u32>(2u);
                        let c = max(tile, a) - row;
                        let d = min(tile + 3u, b) - row;
                        if (behind <= bound_through(v, s, p, size, c, d)) {
                            return false;
                        }
                    }
                }
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

fn is_chosen(place: u32) -> bool {
    return ((atomicLoad(&chosen[place / 32u]) >> (place % 32u)) & 1u) != 0u;
}

// One past the last of a run of chosen chunks beginning at a place, within the workgroup's.
fn end_of_run(place: u32) -> u32 {
    var first = place % 32u;
    for (var w = place / 32u; w < WORDS; w++) {
        let without = ~atomicLoad(&chosen[w]) & (0xffffffffu << first);
        if (without != 0u) {
            return w * 32u + firstTrailingBit(without);
        }
        first = 0u;
    }
    return GROUP;
}

// With `only_seen`, asks only for chunks seen lately by a group of hemicubes.
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
            if (!only_seen || seen[index] + settings.looks_back >= v.stamp) {
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
        // Consecutive chunks are one draw. A draw begins at every chunk without a chosen one before it.
        var before = count;
        var carry = 0u;
        for (var w = 0u; w < WORDS; w++) {
            let word = atomicLoad(&chosen[w]);
            let begins = word & ~((word << 1u) | carry);
            carry = word >> 31u;
            let all = countOneBits(begins);
            if (w < local / 32u) {
                before += all;
            } else if (w == local / 32u) {
                before += countOneBits(begins & ((1u << (local % 32u)) - 1u));
            }
            count += all;
        }
        if (found == VISIBLE) {
            if (local == 0u || !is_chosen(local - 1u)) {
                let last = start + end_of_run(local) - 1u;
                let first_index = chunks[index].first_index;
                let at = (face * settings.chunk_count + before) * 5u;
                draws[at] = chunks[last].first_index + chunks[last].index_count - first_index;
                draws[at + 1u] = 1u;
                draws[at + 2u] = first_index;
                draws[at + 3u] = 0u;
                draws[at + 4u] = 0u;
            }
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

// Lists the chunks drawn first, for depths only.
@compute @workgroup_size(GROUP)
fn cull_seen(@builtin(local_invocation_index) local: u32, @builtin(workgroup_id) group: vec3<u32>) {
    list(local, views[(view.slot + group.y) * 5u + group.x], true, false);
}

// Lists the chunks not behind these depths.
@compute @workgroup_size(GROUP)
fn cull_hidden(@builtin(local_invocation_index) local: u32, @builtin(workgroup_id) group: vec3<u32>) {
    list(local, views[(view.slot + group.y) * 5u + group.x], false, true);
}

// Lists all chunks in view.
@compute @workgroup_size(GROUP)
fn cull_outside(@builtin(local_invocation_index) local: u32, @builtin(workgroup_id) group: vec3<u32>) {
    list(local, views[(view.slot + group.y) * 5u + group.x], false, false);
}
