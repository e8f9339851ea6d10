// Draws hemicubes by compute alone: `draw=compute`. A workgroup owns a tile of a face, and each of its threads some
// pixels of it, with their nearest depths and ids in registers: no atomics, and the same ids in any order.
//
//   list runs of chunks ▶ of the nearest runs list chunks ▶ chunk by chunk, the nearest first: prepare triangles ▶
//   test pixels ▶ sums, ids, depths
//
// Edges are those of the settle stage, to the bit: a centre is in a triangle if three products say so, which two
// triangles compute with opposite signs. Depths are of triangles' planes; of equal ones the smaller id is seen.
//
// Triangles are prepared one a thread. A small one, of FEW pixels at most, its thread draws alone, into depths and ids
// that the workgroup shares: depths first, then ids where the depth is still there. Large ones are tested one after
// another by all threads, each on its own pixels. Bounds on what is left out are exact where they can be: rounding is
// monotone, so that the product at a corner of the tile bounds it in between.
//
// Workgroups are persistent: each takes the next tile of all hemicubes of a group from a queue, until none is left or it
// has drawn `tiles_each`. Mesa's drivers on the processor end all loops of a thread after 65,535 rounds together: a tile
// is drawn whole or not added up, and then the row's sum is short, which is an error.

@group(1) @binding(3) var<storage, read> chunks: array<Chunk>;
@group(1) @binding(12) var<storage, read> weights: array<u32>;
@group(1) @binding(13) var<storage, read_write> visible: array<atomic<u32>>;
@group(1) @binding(14) var<storage, read_write> touched: array<atomic<u32>>;
@group(1) @binding(15) var<storage, read> vertices: array<Vertex>;
@group(1) @binding(16) var<storage, read> indices: array<u32>;
@group(1) @binding(25) var<storage, read_write> depth_copy: array<f32>;
@group(1) @binding(29) var settled_items: texture_storage_2d_array<r32uint, write>;

const GROUP: u32 = 64u;
// Strips of 32 × 8 pixels, one below the other: four pixels of each a thread. `TILE` of src/limits.rs.
const STRIPS: u32 = 2u;
const HIGH: u32 = 8u * STRIPS;
// Runs listed at once, and chunks. A round adds at most GROUP of either.
const RUNS: u32 = 256u;
const LIST: u32 = 128u;
// Chunks of a run, at most: `OF_A_RUN` of src/chunks.rs.
const OF_A_RUN: u32 = 32u;
const NOBODY: u32 = 0xffffffffu;
// Nearer than any depth.
const NEAREST: f32 = 3e38;
const PIXELS: u32 = 32u * HIGH;
// Pixel centres within the bounds of a small triangle, at most. A choice: with 4 to 64, a room of 10,240 triangles takes
// 116 to 74 ms on lavapipe (191 without, 0ea0ea42), the tile the same (`device_rate 128 8 room denhaag`). On a GPU,
// threads that wait for the one with the largest triangle take as long as all do to test eight large ones.
const FEW: u32 = 32u;

// A triangle prepared for a tile.
struct Ready {
    // Planes through the eye and a side, along the face's axes, inwards. w: 1 where a centre on it is inside.
    sides: array<vec4<f32>, 3>,
    // The depth in a direction of the face, but for w, a factor below 1 for backs that block.
    plane: vec4<f32>,
    // The least and the greatest depth of the corners.
    least: f32,
    greatest: f32,
    id: u32,
    // The rows that it may cover, as directions: the least and the greatest y.
    low: f32,
    high: f32,
    // The pixels of the tile that it may cover: x, y of the first, columns, rows. Without columns it is not seen.
    box: vec4<u32>,
}

// The directions of a tile's outermost pixel centres, in whole numbers: x, y of the first, x, y of the last.
struct Tile {
    ends: vec4<f32>,
    // Its first pixel on the face.
    first: vec2<u32>,
    axes: Axes,
}

var<private> depths: array<vec4<f32>, STRIPS>;
var<private> ids: array<vec4<u32>, STRIPS>;

// Runs, then chunks: their numbers and bounds as they were found, and their places there, the nearest first.
var<workgroup> numbers: array<u32, RUNS + LIST>;
var<workgroup> bounds: array<f32, RUNS + LIST>;
var<workgroup> sorted: array<u32, RUNS + LIST>;
var<workgroup> listed: atomic<u32>;
// Their number after a round, and 1 if more may follow.
var<workgroup> listed_now: vec2<u32>;
var<workgroup> chosen: u32;
var<workgroup> ready: array<Ready, GROUP>;
var<workgroup> ready_count: atomic<u32>;
// The farthest depth of the tile: bits of floats above 0 are in their order.
var<workgroup> farthest: atomic<u32>;
// Depths of the small triangles, as bits, and their ids.
var<workgroup> small_depths: array<atomic<u32>, PIXELS>;
var<workgroup> small_ids: array<atomic<u32>, PIXELS>;

fn tile_of(v: View, group: vec2<u32>) -> Tile {
    let n = settings.resolution;
    let first = group * vec2<u32>(32u, HIGH);
    let last = min(first + vec2<u32>(31u, HIGH - 1u), vec2<u32>(n, v.rows) - 1u);
    let shift = vec2<i32>(vec2<u32>(n, select(0u, n, v.face == 0u)));
    let a = vec2<f32>(vec2<i32>(2u * first + 1u) - shift);
    let b = vec2<f32>(vec2<i32>(2u * last + 1u) - shift);
    return Tile(vec4<f32>(a, b), first, axes_of(v));
}

// A bound on the depths of a chunk in a tile; below 0 if it is outside.
fn bound_of(v: View, tile: Tile, chunk: Chunk) -> f32 {
    let n = f32(settings.resolution);
    let axes = tile.axes;
    let c = along(axes, (chunk.center_high - v.eye_high) + (chunk.center_low - v.eye_low));
    let h = chunk.half_sides;
    let a = h.x * vec3<f32>(axes.right.x, axes.up.x, axes.forward.x);
    let b = h.y * vec3<f32>(axes.right.y, axes.up.y, axes.forward.y);
    let d = h.z * vec3<f32>(axes.right.z, axes.up.z, axes.forward.z);
    // More than rounding, and than corners are moved when they are put into the emitter's plane.
    let margin = v.tolerance + 4e-6 * (abs(c.x) + abs(c.y) + abs(c.z) + h.x + h.y + h.z);
    // The planes of the tile: left and right, below and above.
    let left = vec4<f32>(n * c.xy - tile.ends.xy * c.z, tile.ends.zw * c.z - n * c.xy);
    let reach = abs(vec4<f32>(n * a.xy - tile.ends.xy * a.z, tile.ends.zw * a.z - n * a.xy))
        + abs(vec4<f32>(n * b.xy - tile.ends.xy * b.z, tile.ends.zw * b.z - n * b.xy))
        + abs(vec4<f32>(n * d.xy - tile.ends.xy * d.z, tile.ends.zw * d.z - n * d.xy));
    let deep = abs(a.z) + abs(b.z) + abs(d.z) + margin;
    if (any(left + reach < vec4<f32>(-2.0 * n * margin)) || c.z + deep < 0.0) {
        return -1.0;
    }
    let nearest = c.z - deep;
    return select(NEAREST, v.near / nearest * 1.00001, nearest > margin);
}

// Adds what a thread found to a list that begins at `base`, if the tile may see it.
fn add_to_list(base: u32, number: u32, bound: f32) {
    if (bound >= bitcast<f32>(atomicLoad(&farthest))) {
        let at = base + atomicAdd(&listed, 1u);
        numbers[at] = number;
        bounds[at] = bound;
    }
}

// Ranks a list of `count` from `base` on: lists are short.
fn sort(local: u32, base: u32, count: u32) {
    for (var i = base + local; i < base + count; i += GROUP) {
        let mine = bounds[i];
        var rank = base;
        for (var k = base; k < base + count; k++) {
            rank += u32(bounds[k] > mine || (bounds[k] == mine && k < i));
        }
        sorted[rank] = i;
    }
    workgroupBarrier();
}

// Lists runs of the tile from a number on. Returns the first number left, and how many were listed.
fn list_runs(local: u32, v: View, tile: Tile, from_number: u32) -> vec2<u32> {
    if (local == 0u) {
        atomicStore(&listed, 0u);
    }
    workgroupBarrier();
    var first = from_number;
    var count = 0u;
    loop {
        let number = first + local;
        if (number < settings.run_count) {
            add_to_list(0u, number, bound_of(v, tile, chunks[settings.chunk_count + number]));
        }
        first += GROUP;
        workgroupBarrier();
        if (local == 0u) {
            listed_now = vec2<u32>(atomicLoad(&listed), 0u);
        }
        count = workgroupUniformLoad(&listed_now).x;
        if (count > RUNS - GROUP || first >= settings.run_count) {
            break;
        }
    }
    sort(local, 0u, count);
    return vec2<u32>(first, count);
}

// Returns whether the run at a place of `runs` sorted ones may still be seen. If not, none after it is.
fn may_be_seen(place: u32, runs: u32) -> bool {
    return place < runs && bounds[sorted[place]] >= bitcast<f32>(atomicLoad(&farthest));
}

// Lists chunks of the tile from a place of `runs` sorted runs on. Returns the first place left, how many were listed,
// and 1 if runs are left that may be seen.
fn list_chunks(local: u32, v: View, tile: Tile, from_place: u32, runs: u32) -> vec3<u32> {
    if (local == 0u) {
        atomicStore(&listed, 0u);
    }
    workgroupBarrier();
    var place = from_place;
    var now = vec2<u32>(0u);
    loop {
        // So many runs at once.
        let mine = place + local / OF_A_RUN;
        if (may_be_seen(mine, runs)) {
            let run = chunks[settings.chunk_count + numbers[sorted[mine]]];
            if (local % OF_A_RUN < run.index_count) {
                let number = run.first_index + local % OF_A_RUN;
                add_to_list(RUNS, number, bound_of(v, tile, chunks[number]));
            }
        }
        place += GROUP / OF_A_RUN;
        workgroupBarrier();
        if (local == 0u) {
            listed_now = vec2<u32>(atomicLoad(&listed), u32(may_be_seen(place, runs)));
        }
        now = workgroupUniformLoad(&listed_now);
        if (now.x > LIST - GROUP || now.y == 0u) {
            break;
        }
    }
    sort(local, RUNS, now.x);
    return vec3<u32>(place, now);
}

// Returns whether a side points at the eye but for 1/30. Rounding moves its plane by 1 over that angle's sine, which the
// margin of a box holds no further.
fn points_at_the_eye(t: Outline) -> bool {
    var found = false;
    for (var k = 0u; k < 3u; k++) {
        let p = t.corners[k];
        let q = t.corners[(k + 1u) % 3u];
        let most = 1e-3 * dot(p + q, p + q) * dot(q - p, q - p);
        found = found || dot(t.sides[k], t.sides[k]) <= most;
    }
    return found;
}

// Prepares a triangle. Its box is empty if it is not seen in the tile.
fn prepare(v: View, tile: Tile, number: u32) -> Ready {
    var found: Ready;
    found.box = vec4<u32>(0u);
    let n = f32(settings.resolution);
    let a = vertices[indices[3u * number]];
    if (a.front == v.emitter || a.back == v.emitter) {
        return found;
    }
    let b = vertices[indices[3u * number + 1u]];
    let c = vertices[indices[3u * number + 2u]];
    let t = outline(v, tile.axes, a, b, c);
    let p = t.corners[0];
    let q = t.corners[1];
    let r = t.corners[2];
    // All corners beyond one plane of the tile.
    let slack = -1e-5 * n;
    let all = max(
        max(
            vec4<f32>(n * p.xy - tile.ends.xy * p.z, tile.ends.zw * p.z - n * p.xy),
            vec4<f32>(n * q.xy - tile.ends.xy * q.z, tile.ends.zw * q.z - n * q.xy),
        ),
        vec4<f32>(n * r.xy - tile.ends.xy * r.z, tile.ends.zw * r.z - n * r.xy),
    );
    let extent = max(max(abs(p), abs(q)), abs(r));
    let deepest = max(max(p.z, q.z), r.z);
    let is_beyond = any(all < vec4<f32>(slack * (extent.x + extent.y + extent.z)));
    if (is_beyond || deepest <= 0.0 || t.volume == 0.0) {
        return found;
    }
    found.low = -NEAREST;
    found.high = NEAREST;
    var box = vec4<u32>(0u, 0u, 32u, HIGH);
    let shallowest = min(min(p.z, q.z), r.z);
    if (shallowest > 0.0 && !points_at_the_eye(t)) {
        // Sides are those of the corners but for rounding, and for heights put into the emitter's plane.
        let margin = n * (8e-6 * (extent.x + extent.y + extent.z) + v.tolerance) / shallowest;
        let a_on = p.xy * (n / p.z);
        let b_on = q.xy * (n / q.z);
        let c_on = r.xy * (n / r.z);
        let low = min(min(a_on, b_on), c_on) - margin;
        let high = max(max(a_on, b_on), c_on) + margin;
        // Most triangles of a fine mesh lie between the centres of two pixels.
        let first = ceil(max(0.5 * (low - tile.ends.xy), vec2<f32>(0.0)));
        let last = floor(0.5 * (min(high, tile.ends.zw) - tile.ends.xy));
        if (any(first > last)) {
            return found;
        }
        found.low = low.y;
        found.high = high.y;
        box = vec4<u32>(vec2<u32>(first), vec2<u32>(last - first) + 1u);
    }
    for (var k = 0u; k < 3u; k++) {
        let side = t.sides[k];
        found.sides[k] = vec4<f32>(side, select(0.0, 1.0, side_of(side, vec3<f32>(0.0)) > 0.0));
        if (dot_fused(side, greatest_in(tile, side, n)) < 0.0) {
            return found;
        }
    }
    found.id = select(a.front, a.back, t.volume > 0.0);
    let normal = vec3<f32>(a.normal_x, a.normal_y, a.normal_z);
    let from_eye = relative(v, high_of(a), low_of(a));
    let height = normal.x * from_eye.x + normal.y * from_eye.y + normal.z * from_eye.z;
    let scale = select(v.near / (height * n), 0.0, height == 0.0);
    // Rounding of the corner, of the normal, and of three products each: `plane_on_face`.
    let error = (abs(from_eye.x) + abs(from_eye.y) + abs(from_eye.z)) * 2.384185791015625e-7 / abs(height);
    let factor = select(1.0, behind(vec4<f32>(error), 1.0), found.id == settings.patch_count);
    found.plane = vec4<f32>(scale * along(tile.axes, normal), factor);
    // Planes seen edge-on are too uncertain: depths stay within those of the corners.
    found.least = v.near / deepest * 0.999999;
    found.greatest = select(1.0, min(v.near / shallowest * 1.000001, 1.0), shallowest > 0.0);
    let nearest = dot_fused(found.plane.xyz, greatest_in(tile, found.plane.xyz, n));
    if (clamp(nearest, found.least, found.greatest) * factor >= bitcast<f32>(atomicLoad(&farthest))) {
        found.box = box;
    }
    return found;
}

// Draws a small triangle into the shared pixels: its depths, or its ids where nothing nearer was drawn.
fn draw_small(tile: Tile, t: Ready, ids_now: bool) {
    let n = f32(settings.resolution);
    for (var i = 0u; i < t.box.z * t.box.w; i++) {
        let at = t.box.xy + vec2<u32>(i % t.box.z, i / t.box.z);
        let direction = tile.ends.xy + 2.0 * vec2<f32>(at);
        let x = vec4<f32>(direction.x);
        let inside = is_inside(t.sides[0], x, direction.y, n).x
            && is_inside(t.sides[1], x, direction.y, n).x
            && is_inside(t.sides[2], x, direction.y, n).x;
        if (!inside) {
            continue;
        }
        let bits = bitcast<u32>(depth_at(t, x, direction.y, n).x);
        let pixel = 32u * at.y + at.x;
        if (ids_now) {
            if (atomicLoad(&small_depths[pixel]) == bits) {
                atomicMin(&small_ids[pixel], t.id);
            }
        } else if (atomicMax(&small_depths[pixel], bits) < bits) {
            atomicStore(&small_ids[pixel], NOBODY);
        }
    }
}

// Takes what small triangles show in a thread's pixels, the first of them at a place of the tile.
fn take_small(first: vec2<u32>) {
    for (var k = 0u; k < STRIPS; k++) {
        for (var i = 0u; i < 4u; i++) {
            let pixel = 32u * (first.y + 8u * k) + first.x + i;
            let depth = bitcast<f32>(atomicLoad(&small_depths[pixel]));
            let id = atomicLoad(&small_ids[pixel]);
            if (depth > depths[k][i] || (depth == depths[k][i] && id < ids[k][i])) {
                depths[k][i] = depth;
                ids[k][i] = id;
            }
        }
    }
}

fn depth_at(t: Ready, x: vec4<f32>, y: f32, n: f32) -> vec4<f32> {
    let plane = fma(vec4<f32>(t.plane.x), x, vec4<f32>(fma(t.plane.y, y, t.plane.z * n)));
    return clamp(plane, vec4<f32>(t.least), vec4<f32>(t.greatest)) * t.plane.w;
}

// The corner of a tile where a product is greatest.
fn greatest_in(tile: Tile, along: vec3<f32>, n: f32) -> vec3<f32> {
    return vec3<f32>(select(tile.ends.xy, tile.ends.zw, along.xy > vec2<f32>(0.0)), n);
}

fn is_inside(side: vec4<f32>, x: vec4<f32>, y: f32, n: f32) -> vec4<bool> {
    let product = fma(vec4<f32>(side.x), x, vec4<f32>(fma(side.y, y, side.z * n)));
    return (product > vec4<f32>(0.0)) | ((product == vec4<f32>(0.0)) & vec4<bool>(side.w != 0.0));
}

// Tests a thread's pixels against the prepared triangles. x, y: the direction of its first pixel.
fn test(x: vec4<f32>, y: f32) {
    let n = f32(settings.resolution);
    let count = atomicLoad(&ready_count);
    for (var i = 0u; i < count; i++) {
        let t = ready[i];
        for (var k = 0u; k < STRIPS; k++) {
            let down = y + 16.0 * f32(k);
            if (down < t.low || down > t.high) {
                continue;
            }
            let inside = is_inside(t.sides[0], x, down, n)
                & is_inside(t.sides[1], x, down, n)
                & is_inside(t.sides[2], x, down, n);
            let depth = depth_at(t, x, down, n);
            let best = depths[k];
            let nearer = inside & ((depth > best) | ((depth == best) & (vec4<u32>(t.id) < ids[k])));
            depths[k] = select(best, depth, nearer);
            ids[k] = select(ids[k], vec4<u32>(t.id), nearer);
        }
    }
}

// The number of the chunk at a place of the sorted list; `NOBODY` after the last, and where all that follow are hidden.
fn choose(place: u32) -> u32 {
    if (place >= atomicLoad(&listed)) {
        return NOBODY;
    }
    let i = sorted[RUNS + place];
    return select(numbers[i], NOBODY, bounds[i] < bitcast<f32>(atomicLoad(&farthest)));
}

// Draws the listed chunks, the nearest first. x, y: the direction of a thread's first pixel.
fn draw_listed(local: u32, v: View, tile: Tile, x: vec4<f32>, y: f32) {
    var place = 0u;
    loop {
        if (local == 0u) {
            chosen = choose(place);
        }
        let number = workgroupUniformLoad(&chosen);
        if (number == NOBODY) {
            break;
        }
        place++;
        let first = chunks[number].first_index / 3u;
        let count = chunks[number].index_count / 3u;
        for (var part = 0u; part < count; part += GROUP) {
            if (local == 0u) {
                atomicStore(&ready_count, 0u);
            }
            workgroupBarrier();
            var mine: Ready;
            mine.box = vec4<u32>(0u);
            if (part + local < count) {
                mine = prepare(v, tile, first + part + local);
            }
            let is_small = mine.box.z * mine.box.w <= FEW;
            if (is_small) {
                draw_small(tile, mine, false);
            } else {
                ready[atomicAdd(&ready_count, 1u)] = mine;
            }
            workgroupBarrier();
            if (is_small) {
                draw_small(tile, mine, true);
            }
            test(x, y);
            workgroupBarrier();
        }
        take_small(vec2<u32>(4u * (local % 8u), local / 8u));
        if (local == 0u) {
            atomicStore(&farthest, 0x7f000000u);
        }
        workgroupBarrier();
        var least = depths[0];
        for (var k = 1u; k < STRIPS; k++) {
            least = min(least, depths[k]);
        }
        let of_all = min(min(least.x, least.y), min(least.z, least.w));
        atomicMin(&farthest, bitcast<u32>(of_all));
        workgroupBarrier();
    }
}

fn draw(local: u32, v: View, tile: Tile) {
    let n = settings.resolution;
    let at = tile.first + vec2<u32>(4u * (local % 8u), local / 8u);
    let x = tile.ends.x + f32(8u * (local % 8u)) + vec4<f32>(0.0, 2.0, 4.0, 6.0);
    let y = tile.ends.y + f32(2u * (local / 8u));
    for (var k = 0u; k < STRIPS; k++) {
        // Beyond the face nothing is drawn.
        let is_beyond = vec4<bool>(at.y + 8u * k >= v.rows) | (vec4<u32>(0u, 1u, 2u, 3u) + at.x >= vec4<u32>(n));
        depths[k] = select(vec4<f32>(0.0), vec4<f32>(NEAREST), is_beyond);
        ids[k] = vec4<u32>(settings.patch_count + 1u);
    }
    for (var pixel = local; pixel < PIXELS; pixel += GROUP) {
        atomicStore(&small_depths[pixel], 0u);
        atomicStore(&small_ids[pixel], NOBODY);
    }
    if (local == 0u) {
        atomicStore(&farthest, 0u);
    }
    var next_run = 0u;
    while (next_run < settings.run_count) {
        let runs = list_runs(local, v, tile, next_run);
        next_run = runs.x;
        var place = 0u;
        loop {
            let found = list_chunks(local, v, tile, place, runs.y);
            place = found.x;
            draw_listed(local, v, tile, x, y);
            if (found.z == 0u) {
                break;
            }
        }
    }
}

fn add(layer: u32, id: u32, weight: u32) {
    let before = atomicAdd(&visible[layer * (settings.patch_count + 2u) + id], weight);
    if (before == 0u && id < settings.patch_count) {
        atomicOr(&touched[layer * settings.word_count + id / 32u], 1u << (id % 32u));
    }
}

// Adds the weights of a thread's pixels; equal neighbours at once.
fn add_up(local: u32, v: View, tile: Tile) {
    let n = settings.resolution;
    for (var k = 0u; k < STRIPS; k++) {
        let at = tile.first + vec2<u32>(4u * (local % 8u), local / 8u + 8u * k);
        if (at.x < n && at.y < v.rows) {
            let pixel = (v.first_row + at.y) * n + at.x;
            var rest = vec4<u32>(weights[pixel], weights[pixel + 1u], weights[pixel + 2u], weights[pixel + 3u]);
            for (var i = 0u; i < 4u; i++) {
                if (rest[i] != 0u) {
                    let same = ids[k] == vec4<u32>(ids[k][i]);
                    let these = select(vec4<u32>(0u), rest, same);
                    add(v.layer, ids[k][i], these.x + these.y + these.z + these.w);
                    rest = select(rest, vec4<u32>(0u), same);
                }
            }
        }
    }
}

// Tiles of a hemicube: columns of a face, rows of its top and of a side.
fn tiles_of_faces() -> vec3<u32> {
    let n = settings.resolution;
    return vec3<u32>((n + 31u) / 32u, (n + HIGH - 1u) / HIGH, (n / 2u + HIGH - 1u) / HIGH);
}

// Tiles of a hemicube: `Plan::tiles`.
fn tiles_of_hemicube() -> u32 {
    let tiles = tiles_of_faces();
    return tiles.x * (tiles.y + 4u * tiles.z);
}

// A tile's place: its column, its row on its face, and the number of its view.
fn place_of(number: u32, of_layer: u32) -> vec3<u32> {
    let tiles = tiles_of_faces();
    let first_view = 5u * (view.slot + number / of_layer);
    let column = number % of_layer % tiles.x;
    let row = number % of_layer / tiles.x;
    if (row < tiles.y) {
        return vec3<u32>(column, row, first_view);
    }
    return vec3<u32>(column, (row - tiles.y) % tiles.z, first_view + 1u + (row - tiles.y) / tiles.z);
}

// The number of the next tile, for all threads of a workgroup that has drawn so many; `NOBODY` where it draws no more.
fn take_tile(local: u32, drawn: u32) -> u32 {
    if (local == 0u) {
        chosen = NOBODY;
        if (drawn < settings.tiles_each) {
            chosen = atomicAdd(&visible[settings.queue], 1u);
        }
    }
    return workgroupUniformLoad(&chosen);
}

// Returns whether loops go on: once a driver has ended one, it ends every later one after its first round.
fn loops_go_on() -> bool {
    var at = 0u;
    while (at < settings.resolution) {
        at += 8u;
    }
    return at >= settings.resolution;
}

// Draws a tile and adds it up.
fn draw_whole(local: u32, v: View, tile: Tile) {
    draw(local, v, tile);
    if (loops_go_on()) {
        add_up(local, v, tile);
    }
}

// For rows without covered weights. Groups: any number, layers: together they draw the tiles of all layers.
@compute @workgroup_size(GROUP)
fn draw_tiles(@builtin(local_invocation_index) local: u32, @builtin(num_workgroups) groups: vec3<u32>) {
    let of_layer = tiles_of_hemicube();
    var drawn = 0u;
    for (var number = take_tile(local, 0u); number < groups.y * of_layer; number = take_tile(local, drawn)) {
        let place = place_of(number, of_layer);
        let v = views[place.z];
        draw_whole(local, v, tile_of(v, place.xy));
        drawn++;
    }
}

// For covered weights, and for item buffers: keeps ids and depths, too.
@compute @workgroup_size(GROUP)
fn keep_tiles(@builtin(local_invocation_index) local: u32, @builtin(num_workgroups) groups: vec3<u32>) {
    let of_layer = tiles_of_hemicube();
    var drawn = 0u;
    for (var number = take_tile(local, 0u); number < groups.y * of_layer; number = take_tile(local, drawn)) {
        let place = place_of(number, of_layer);
        let v = views[place.z];
        let tile = tile_of(v, place.xy);
        draw_whole(local, v, tile);
        keep(local, v, tile);
        drawn++;
    }
}

fn keep(local: u32, v: View, tile: Tile) {
    let n = settings.resolution;
    for (var k = 0u; k < STRIPS; k++) {
        let at = tile.first + vec2<u32>(4u * (local % 8u), local / 8u + 8u * k);
        if (at.x < n && at.y < v.rows) {
            let row = v.first_row + at.y;
            for (var i = 0u; i < 4u; i++) {
                let there = vec2<i32>(vec2<u32>(at.x + i, row));
                textureStore(settled_items, there, i32(v.layer), vec4<u32>(ids[k][i], 0u, 0u, 0u));
                depth_copy[(v.layer * 3u * n + row) * n + at.x + i] = depths[k][i];
            }
        }
    }
}
