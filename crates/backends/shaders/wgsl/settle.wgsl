// For `edges=exact`. Drivers snap corners to a fraction of a pixel before they rasterise: a pixel centre very near an
// edge may show the wrong side of it. Here the edges of all visible triangles are walked, pixels with an edge near
// their centre are listed, and each of these is given to the triangle containing its centre.
//
//   reduce_sides ▶ near_edges ▶ settle ▶ put_settled ▶ … ▶ cover ▶ take_back
//
// The decision on a pixel depends on the drawn ids only: ids are read from the images, listed, and only then put back.
// Sums move from one patch to another in integers. The order, which differs, therefore does not matter.
//
// Software runs the longer branch for all threads if one takes it, and every loop once: hence lists, and loops that
// look for rare cases before these are dealt with.

@group(1) @binding(11) var items: texture_2d_array<u32>;
@group(1) @binding(12) var<storage, read> weights: array<u32>;
@group(1) @binding(13) var<storage, read_write> visible: array<atomic<u32>>;
@group(1) @binding(14) var<storage, read_write> touched: array<atomic<u32>>;
@group(1) @binding(15) var<storage, read> vertices: array<Vertex>;
@group(1) @binding(16) var<storage, read> indices: array<u32>;
@group(1) @binding(17) var<storage, read> triangle_of_patch: array<u32>;
@group(1) @binding(18) var<storage, read> entries: array<u32>;
@group(1) @binding(21) var<storage, read> totals: array<u32>;
@group(1) @binding(22) var<storage, read_write> hidden: array<atomic<u32>>;
// A bit for each pixel near an edge, the number of these, and the number of visible ids: [layer][3 N² / 32 + 2].
@group(1) @binding(26) var<storage, read_write> near: array<atomic<u32>>;
// Those pixels in any order, three words each: the pixel, its settled id, its drawn id. Then the visible ids, in any
// order. [layer][4 · 3 N²].
@group(1) @binding(27) var<storage, read_write> listed: array<u32>;
// The visible weight of each id: [layer][2 patch_count + 2].
@group(1) @binding(28) var<storage, read_write> sides: array<atomic<u32>>;
@group(1) @binding(29) var settled_items: texture_storage_2d_array<r32uint, write>;

const RUN: u32 = 32u;
const GROUP: u32 = 64u;
// The distance from a pixel's centre within which an edge is looked at, in pixels along its shorter axis. The error of
// corners is half of 1/256 in x and in y, that of edges at most 1/256 along that axis; the rest is for drivers that
// truncate, and for rounding.
const NEAR_CENTRE: f32 = 0.0078125;
// A neighbour hides a pixel's id if it is nearer by this part of 1 / distance: above the rounding of two depths.
const IN_FRONT: f32 = 1.00001;
// Bound of the sides walked across from a triangle that a pixel shows to the one that covers its centre. Corners are off by
// half of 1/256 of a pixel, so that but a few are crossed. A choice: with more, software drivers take longer at each pixel
// near an edge; with fewer, triangles that are as small keep what the driver gave them.
const MOST_BESIDE: u32 = 8u;
// Flag of a listed pixel outside the triangle of its drawn id.
const OUTSIDE: u32 = 0x80000000u;

fn pixel_count() -> u32 {
    return 3u * settings.resolution * settings.resolution;
}

// The place of a layer's bits in `near`.
fn near_base(layer: u32) -> u32 {
    return layer * (pixel_count() / RUN + 2u);
}

// The place in `near` of the number of a layer's pixels.
fn near_count(layer: u32) -> u32 {
    return near_base(layer) + pixel_count() / RUN;
}

// The place in `near` of the number of a layer's visible ids.
fn shown_count(layer: u32) -> u32 {
    return near_count(layer) + 1u;
}

// The place of a layer's pixels in `listed`.
fn listed_base(layer: u32) -> u32 {
    return layer * 4u * pixel_count();
}

// The place of a layer's visible ids in `listed`.
fn shown_base(layer: u32) -> u32 {
    return listed_base(layer) + 3u * pixel_count();
}

// The place of an id's weight in `visible`: backs are all blocked.
fn visible_at(layer: u32, id: u32) -> u32 {
    let place = select(id, settings.patch_count, id > settings.patch_count + 1u);
    return layer * (settings.patch_count + 2u) + place;
}

// Marks a patch in the row; other ids are left out.
fn touch(layer: u32, id: u32) {
    if (id < settings.patch_count) {
        atomicOr(&touched[layer * settings.word_count + id / 32u], 1u << (id % 32u));
    }
}

fn add_side(layer: u32, id: u32, weight: u32) {
    let before = atomicAdd(&sides[layer * (2u * settings.patch_count + 2u) + id], weight);
    // Once for each id. Ids visible in weightless pixels only do not count.
    if (before == 0u && weight > 0u) {
        listed[shown_base(layer) + atomicAdd(&near[shown_count(layer)], 1u)] = id;
    }
}

// The reduction with backs told apart, and with a list of visible ids.
@compute @workgroup_size(GROUP)
fn reduce_sides(@builtin(global_invocation_id) run: vec3<u32>) {
    let n = settings.resolution;
    let first = run.x * RUN;
    if (first >= pixel_count()) {
        return;
    }
    let layer = view.layer + run.y;
    atomicStore(&near[near_base(layer) + run.x], 0u);
    if (run.x == 0u) {
        atomicStore(&near[near_count(layer)], 0u);
    }
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
            add_side(layer, current, sum);
            current = id;
            sum = 0u;
        }
        sum += weight;
    }
    add_side(layer, current, sum);
}

fn turned(v: View, d: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot_fused(v.tangent, d), dot_fused(v.bitangent, d), dot_fused(v.normal, d));
}

// A corner in the hemicube's frame, computed by `in_frame`.
fn placed(v: View, c: Vertex) -> vec3<f32> {
    let p = turned(v, (high_of(c) - v.eye_high) + (low_of(c) - v.eye_low));
    let snap = fma(abs(p.x) + abs(p.y), 9.5367431640625e-7, v.tolerance);
    return vec3<f32>(p.xy, select(p.z, 0.0, abs(p.z) <= snap));
}

// The vector from one corner to another. The difference is taken before the eye is subtracted, so that short edges keep
// their digits, and it changes sign exactly with its ends.
fn between(v: View, from_corner: Vertex, to_corner: Vertex, from_place: vec3<f32>, to_place: vec3<f32>) -> vec3<f32> {
    let d = turned(v, (high_of(to_corner) - high_of(from_corner)) + (low_of(to_corner) - low_of(from_corner)));
    // With one end in the emitter's plane, that end decides.
    return vec3<f32>(d.xy, select(d.z, to_place.z - from_place.z, from_place.z == 0.0 || to_place.z == 0.0));
}

struct Triangle {
    places: array<vec3<f32>, 3>,
    // From each corner to the next.
    sides: array<vec3<f32>, 3>,
}

fn triangle_of(id: u32) -> u32 {
    return triangle_of_patch[select(id, id - settings.patch_count - 2u, id > settings.patch_count)];
}

fn triangle(v: View, number: u32) -> Triangle {
    let a = vertices[indices[3u * number]];
    let b = vertices[indices[3u * number + 1u]];
    let c = vertices[indices[3u * number + 2u]];
    let p = placed(v, a);
    let q = placed(v, b);
    let r = placed(v, c);
    return Triangle(
        array<vec3<f32>, 3>(p, q, r),
        array<vec3<f32>, 3>(between(v, a, b, p, q), between(v, b, c, q, r), between(v, c, a, r, p)),
    );
}

// A vector of the frame along a face's axes: right, up, forward. `Face::axes` of the contract.
fn to_face(face: u32, p: vec3<f32>) -> vec3<f32> {
    switch face {
        case 0u: { return p; }
        case 1u: { return p.yzx; }
        case 2u: { return vec3<f32>(-p.y, p.z, -p.x); }
        case 3u: { return vec3<f32>(-p.x, p.z, p.y); }
        default: { return vec3<f32>(p.x, p.z, -p.y); }
    }
}

fn face_of_row(row: u32) -> u32 {
    let n = settings.resolution;
    return select(0u, 1u + (row - n) / (n / 2u), row >= n);
}

// The direction of a pixel's centre, along the axes of its face. Whole numbers: N times the direction with 1 forward.
fn centre(face: u32, at: vec2<u32>) -> vec3<f32> {
    let n = settings.resolution;
    let first_row = select(n + (face - 1u) * (n / 2u), 0u, face == 0u);
    let up = 2u * (at.y - first_row) + 1u;
    let from_middle = vec2<i32>(vec2<u32>(2u * at.x + 1u, up)) - vec2<i32>(vec2<u32>(n, select(0u, n, face == 0u)));
    return vec3<f32>(vec2<f32>(from_middle), f32(n));
}

// A triangle along the direction of a pixel's centre.
struct There {
    // 1 / distance of its plane but for a factor.
    nearness: f32,
    // For each side, from the first corner on: above 0 if the centre is inside of it.
    sides: vec3<f32>,
    is_back: bool,
}

fn there(v: View, number: u32, face: u32, direction: vec3<f32>) -> There {
    let t = triangle(v, number);
    let p = to_face(face, t.places[0]);
    let q = to_face(face, t.places[1]);
    let r = to_face(face, t.places[2]);
    let to_q = to_face(face, t.sides[0]);
    let to_r = to_face(face, t.sides[1]);
    let to_p = to_face(face, t.sides[2]);
    let across = cross_fused(to_q, to_r);
    let volume = dot_fused(across, p);
    let turn = select(-1.0, 1.0, volume > 0.0);
    // Twice the product of the ends, from terms that change sign exactly when the ends change places.
    let sides = vec3<f32>(
        side_of(turn * cross_fused(p + q, to_q), direction),
        side_of(turn * cross_fused(q + r, to_r), direction),
        side_of(turn * cross_fused(r + p, to_p), direction),
    );
    return There(dot_fused(across, direction) / volume, sides, volume > 0.0);
}

fn is_inside(t: There) -> bool {
    return all(t.sides > vec3<f32>(0.0));
}

// The nearness of a triangle in a direction if it covers the pixel's centre, and 0 otherwise.
fn nearness(v: View, id: u32, face: u32, direction: vec3<f32>) -> f32 {
    let t = there(v, triangle_of(id), face, direction);
    return select(0.0, t.nearness, is_inside(t));
}

// The side that a direction is farthest outside of.
fn worst(t: There) -> u32 {
    let later = select(1u, 2u, t.sides.z < t.sides.y);
    return select(0u, later, min(t.sides.y, t.sides.z) < t.sides.x);
}

// What covers a pixel's centre, if anything was found. Without it `ended` tells that the surface ends there.
struct Found {
    id: u32,
    nearness: f32,
    ended: bool,
}

// From a triangle that misses a pixel's centre, walks across sides to one that covers it and faces the same way: where
// triangles are smaller than pixels, it may be shown nowhere. Without one, the nearness is 0.
fn beside(v: View, id: u32, begin: There, face: u32, direction: vec3<f32>) -> Found {
    let first_of_sides = 3u * settings.triangle_count;
    var start = 3u * triangle_of(id) + worst(begin);
    var side = indices[first_of_sides + start];
    for (var step = 0u; step < MOST_BESIDE && side != start; step++) {
        let other = side / 3u;
        let t = there(v, other, face, direction);
        let owner = vertices[indices[3u * other]];
        let is_folded = t.is_back != begin.is_back;
        if (is_inside(t) && !is_folded) {
            let back = select(owner.back, settings.patch_count + 2u + owner.front, owner.back == settings.patch_count);
            let is_emitter = owner.front == v.emitter || owner.back == v.emitter;
            return Found(select(owner.front, back, t.is_back), select(t.nearness, 0.0, is_emitter), true);
        }
        // Around the same side, or on across another.
        let next = select(3u * other + worst(t), side, is_folded);
        start = select(next, start, next == side);
        side = indices[first_of_sides + next];
    }
    return Found(id, 0.0, side == start);
}

// The distances of a point from the planes bounding a face, widened by a pixel.
fn within(face: u32, p: vec3<f32>) -> vec4<f32> {
    let pixel = 2.0 / f32(settings.resolution);
    let wide = (1.0 + pixel) * p.z;
    let below = select(pixel, 1.0 + pixel, face == 0u) * p.z;
    return vec4<f32>(wide - p.x, wide + p.x, wide - p.y, below + p.y);
}

fn is_outside(face: u32, p: vec3<f32>, q: vec3<f32>) -> bool {
    return any((within(face, to_face(face, p)) < vec4<f32>(0.0)) & (within(face, to_face(face, q)) < vec4<f32>(0.0)));
}

// Lists the pixels of a face with this edge near their centre.
fn walk(layer: u32, face: u32, from_frame: vec3<f32>, along_frame: vec3<f32>) {
    let n = f32(settings.resolution);
    let p = to_face(face, from_frame);
    let d = to_face(face, along_frame);
    // The part of it in view.
    let at_p = within(face, p);
    let at_q = within(face, p + d);
    let crossing = at_p / (at_p - at_q);
    let begins = select(vec4<f32>(0.0), crossing, at_p < vec4<f32>(0.0));
    let ends = select(vec4<f32>(1.0), crossing, at_q < vec4<f32>(0.0));
    let begin = max(max(begins.x, begins.y), max(begins.z, begins.w));
    let end = min(min(ends.x, ends.y), min(ends.z, ends.w));
    let a = p + begin * d;
    let b = p + end * d;
    let is_seen = begin < end && a.z > 0.0 && b.z > 0.0;
    // Its ends in pixels of the face, a centre at whole numbers.
    let shift = vec2<f32>(n, select(0.0, n, face == 0u)) * 0.5 - 0.5;
    let from_pixel = a.xy / a.z * (0.5 * n) + shift;
    let to_pixel = b.xy / b.z * (0.5 * n) + shift;
    let reach = abs(to_pixel - from_pixel);
    let is_steep = reach.y > reach.x;
    let e = cross(p, d);
    let size = vec2<f32>(n, select(0.5 * n, n, face == 0u));
    // x is the longer axis, walked pixel by pixel; the place on the other axis is affine in it.
    let line = select(e.xy, e.yx, is_steep);
    let shifts = select(shift, shift.yx, is_steep);
    let sizes = select(size, size.yx, is_steep);
    let ends_of = select(vec2<f32>(from_pixel.x, to_pixel.x), vec2<f32>(from_pixel.y, to_pixel.y), is_steep);
    let slope = -line.x / line.y;
    let offset = shifts.y - slope * shifts.x - 0.5 * n * e.z / line.y;
    let first_row = select(settings.resolution + (face - 1u) * (settings.resolution / 2u), 0u, face == 0u);
    var major = max(ceil(min(ends_of.x, ends_of.y) - NEAR_CENTRE), 0.0);
    var last = min(floor(max(ends_of.x, ends_of.y) + NEAR_CENTRE), sizes.x - 1.0);
    last = select(-1.0, last, is_seen);
    while (major <= last) {
        var minor = slope * major + offset;
        while (abs(minor - round(minor)) > NEAR_CENTRE && major < last) {
            major += 1.0;
            minor = slope * major + offset;
        }
        let nearest = round(minor);
        if (abs(minor - nearest) <= NEAR_CENTRE && nearest >= 0.0 && nearest < sizes.y) {
            let at = vec2<u32>(select(vec2<f32>(major, nearest), vec2<f32>(nearest, major), is_steep));
            let pixel = (at.y + first_row) * settings.resolution + at.x;
            let bit = 1u << (pixel % RUN);
            if ((atomicOr(&near[near_base(layer) + pixel / RUN], bit) & bit) == 0u) {
                listed[listed_base(layer) + 3u * atomicAdd(&near[near_count(layer)], 1u)] = pixel;
            }
        }
        major += 1.0;
    }
}

// Moves the sums of visible ids to patches, and walks the edges of their triangles. One thread an edge; groups: any
// number, layers.
@compute @workgroup_size(GROUP)
fn near_edges(@builtin(global_invocation_id) thread: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let v = views[(view.slot + thread.y) * 5u];
    let layer = v.layer;
    let count = atomicLoad(&near[shown_count(layer)]);
    for (var i = thread.x; i < count; i += groups.x * GROUP) {
        let id = listed[shown_base(layer) + i];
        let sum = atomicExchange(&sides[layer * (2u * settings.patch_count + 2u) + id], 0u);
        atomicAdd(&visible[visible_at(layer, id)], sum);
        touch(layer, id);
    }
    for (var i = thread.x; i < 3u * count; i += groups.x * GROUP) {
        let id = listed[shown_base(layer) + i / 3u];
        let k = i % 3u;
        var faces = 0u;
        var p = vec3<f32>(0.0);
        var d = vec3<f32>(0.0);
        if (id != settings.patch_count + 1u) {
            let corner = 3u * triangle_of(id);
            let a = vertices[indices[corner + k]];
            let b = vertices[indices[corner + (k + 1u) % 3u]];
            p = placed(v, a);
            let q = placed(v, b);
            d = between(v, a, b, p, q);
            for (var face = 0u; face < 5u; face++) {
                faces |= select(1u << face, 0u, is_outside(face, p, q));
            }
        }
        while (faces != 0u) {
            walk(layer, firstTrailingBit(faces), p, d);
            faces &= faces - 1u;
        }
    }
}

// Groups: any number, layers.
@compute @workgroup_size(GROUP)
fn settle(@builtin(global_invocation_id) thread: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let v = views[(view.slot + thread.y) * 5u];
    let layer = v.layer;
    let n = settings.resolution;
    let escaped = settings.patch_count + 1u;
    let count = atomicLoad(&near[near_count(layer)]);
    for (var i = thread.x; i < count; i += groups.x * GROUP) {
        let place = listed_base(layer) + 3u * i;
        let pixel = listed[place];
        let at = vec2<u32>(pixel % n, pixel / n);
        let face = face_of_row(at.y);
        let direction = centre(face, at);
        let shown = textureLoad(items, vec2<i32>(at), i32(layer), 0).x;
        // Ids shown by the neighbours on the same face.
        let first_row = select(n + (face - 1u) * (n / 2u), 0u, face == 0u);
        let low = vec2<u32>(max(at.x, 1u) - 1u, max(at.y, first_row + 1u) - 1u);
        let high = min(at + 1u, vec2<u32>(n, first_row + select(n / 2u, n, face == 0u)) - 1u);
        var others: array<u32, 8>;
        var other_count = 0u;
        var is_beside_nothing = false;
        var times_shown = 0u;
        for (var y = low.y; y <= high.y; y++) {
            for (var x = low.x; x <= high.x; x++) {
                let id = textureLoad(items, vec2<i32>(vec2<u32>(x, y)), i32(layer), 0).x;
                is_beside_nothing |= id == escaped;
                times_shown += u32(id == shown);
                var is_known = id == shown || id == escaped;
                for (var k = 0u; k < other_count; k++) {
                    is_known |= others[k] == id;
                }
                if (!is_known) {
                    others[other_count] = id;
                    other_count += 1u;
                }
            }
        }
        var kept = 0.0;
        var best = 0.0;
        var chosen = shown;
        if (shown != escaped) {
            let t = there(v, triangle_of(shown), face, direction);
            if (is_inside(t)) {
                kept = t.nearness;
                best = IN_FRONT * kept;
            } else {
                let found = beside(v, shown, t, face, direction);
                if (found.nearness > 0.0) {
                    chosen = found.id;
                    best = IN_FRONT * found.nearness;
                } else if (!found.ended || times_shown == 1u) {
                    // The driver gives a triangle as many pixels wrongly as it leaves out. Those left out of one shown
                    // in no pixel around are not known here: none may be taken from it either.
                    best = IN_FRONT * max(t.nearness, 0.0);
                }
            }
        }
        for (var k = 0u; k < other_count; k++) {
            let other = nearness(v, others[k], face, direction);
            if (other > best) {
                best = other;
                chosen = others[k];
            }
        }
        // In no triangle known here: the id beyond the silhouette.
        if (best == 0.0 && is_beside_nothing) {
            chosen = escaped;
        }
        listed[place] = select(pixel, pixel | OUTSIDE, kept == 0.0);
        listed[place + 1u] = chosen;
        listed[place + 2u] = shown;
        if (chosen != shown) {
            let weight = weights[pixel];
            atomicAdd(&visible[visible_at(layer, chosen)], weight);
            atomicSub(&visible[visible_at(layer, shown)], weight);
            touch(layer, chosen);
        }
    }
}

// Puts settled ids into the item buffer, and takes patches without pixels off the row. Groups: any number, layers.
@compute @workgroup_size(GROUP)
fn put_settled(@builtin(global_invocation_id) thread: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let layer = view.layer + thread.y;
    let n = settings.resolution;
    let count = atomicLoad(&near[near_count(layer)]);
    if (thread.x == 0u) {
        atomicStore(&near[shown_count(layer)], 0u);
    }
    for (var i = thread.x; i < count; i += groups.x * GROUP) {
        let place = listed_base(layer) + 3u * i;
        let id = listed[place + 1u];
        let shown = listed[place + 2u];
        if (id != shown) {
            let pixel = listed[place] & ~OUTSIDE;
            let at = vec2<i32>(vec2<u32>(pixel % n, pixel / n));
            textureStore(settled_items, at, i32(layer), vec4<u32>(id, 0u, 0u, 0u));
            if (shown < settings.patch_count && atomicLoad(&visible[visible_at(layer, shown)]) == 0u) {
                atomicAnd(&touched[layer * settings.word_count + shown / 32u], ~(1u << (shown % 32u)));
            }
        }
    }
}

// The cover stage has the driver's edges, too: it counts a pixel taken from a patch as hidden. Here that weight is
// taken back. Groups: any number, layers.
@compute @workgroup_size(GROUP)
fn take_back(@builtin(global_invocation_id) thread: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let layer = view.layer + thread.y;
    let base = layer * settings.capacity;
    let entry_count = totals[4u * (view.slot + thread.y)];
    let count = atomicLoad(&near[near_count(layer)]);
    for (var i = thread.x; i < count; i += groups.x * GROUP) {
        let place = listed_base(layer) + 3u * i;
        let pixel = listed[place];
        let shown = listed[place + 2u];
        if (pixel >= OUTSIDE && listed[place + 1u] != shown && shown < settings.patch_count) {
            // Entries ascend.
            var first = 0u;
            var end = entry_count;
            while (first < end) {
                let middle = (first + end) / 2u;
                let is_before = entries[2u * (base + middle)] < shown;
                first = select(first, middle + 1u, is_before);
                end = select(middle, end, is_before);
            }
            if (first < entry_count && entries[2u * (base + first)] == shown) {
                atomicSub(&hidden[base + first], weights[pixel & ~OUTSIDE]);
            }
        }
    }
}
