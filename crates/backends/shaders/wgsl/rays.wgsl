// Rays from one patch: the first surface on each, a thread a ray, or that f32 cannot tell. The bounds on rounding are at
// the head of src/rays.rs.

// Two words of four a node of src/rays.rs, three a triangle, four for all rays, and two a ray.
@group(1) @binding(30) var<storage, read> nodes: array<vec4<u32>>;
@group(1) @binding(31) var<storage, read> triangles: array<vec4<u32>>;
@group(1) @binding(32) var<storage, read> given: array<vec4<u32>>;
@group(1) @binding(33) var<storage, read_write> met: array<u32>;

const NOTHING: u32 = 0xffffffffu;
const DOUBTFUL: u32 = 0xfffffffdu;
// Nodes still to look at. A choice: a deeper stack takes registers or memory of every thread; of a tree deeper than this
// rays are the host's.
const STACK: u32 = 48u;
// Nodes and triangles that a ray looks at; of more it is the host's. A choice: with more, eight rays side by side pass the
// 65,535 turns after which lavapipe 22.3.6 ends a shader's loops; with fewer, rays through crowns are the host's.
const MOST_TURNS: u32 = 8000u;
// 2^-20, see src/rays.rs.
const SLACK: f32 = 9.5367431640625e-7;
// Further than any place on a ray.
const NEVER: f32 = 1e9;

struct Ray {
    start: vec3<f32>,
    // The way to depth 1, where depth is along the direction's largest axis.
    way: vec3<f32>,
    inverse: vec3<f32>,
    // The way's first two coordinates once the largest axis is the third.
    shear: vec2<f32>,
    // That axis, and the way's sign on it.
    axis: u32,
    sign: f32,
    // Depth of the end.
    end: f32,
    // Height of the start above the emitter's plane.
    height: f32,
}

struct First {
    id: u32,
    // The first certain surface lies at these depths.
    low: f32,
    high: f32,
    // No other that may be met lies nearer.
    others: f32,
}

// A vector with an axis for its third coordinate, of the same hand.
fn turned(v: vec3<f32>, axis: u32) -> vec3<f32> {
    return select(select(v.xyz, v.zxy, axis == 1u), v.yzx, axis == 0u);
}

fn turned_back(v: vec3<f32>, axis: u32) -> vec3<f32> {
    return select(select(v.xyz, v.yzx, axis == 1u), v.zxy, axis == 0u);
}

fn ray_of(at: u32) -> Ray {
    let first = given[4u + 2u * at];
    let second = bitcast<vec4<f32>>(given[5u + 2u * at]);
    let bits = given[5u + 2u * at].z;
    var ray: Ray;
    ray.start = bitcast<vec3<f32>>(first.xyz);
    ray.end = bitcast<f32>(first.w);
    ray.shear = second.xy;
    ray.axis = bits & 3u;
    ray.sign = select(1.0, -1.0, (bits & 4u) != 0u);
    ray.height = second.w;
    ray.way = turned_back(vec3<f32>(ray.shear * ray.sign, ray.sign), ray.axis);
    // Along an axis that the ray does not move on, a box is met everywhere or nowhere.
    let flat = abs(ray.way) < vec3<f32>(1e-18);
    ray.inverse = select(1.0 / ray.way, vec3<f32>(1e18), flat);
    return ray;
}

// Whether a ray touches a node's box nearer than `until`.
fn touches(ray: Ray, center: vec3<f32>, half: vec3<f32>, until: f32) -> bool {
    let middle = (center - ray.start) * ray.inverse;
    let extent = (half + vec3<f32>(4.0 * SLACK)) * abs(ray.inverse) + 4.0 * SLACK * abs(middle);
    let low = middle - extent;
    let high = middle + extent;
    let first = max(max(low.x, low.y), max(low.z, 0.0));
    let last = min(min(high.x, high.y), min(high.z, until));
    return first <= last;
}

fn cross_of(q: vec2<f32>, r: vec2<f32>) -> f32 {
    return q.x * r.y - q.y * r.x;
}

// The error of a product of two corners on the image, at most.
fn error_of(q: vec2<f32>, r: vec2<f32>, eta: f32) -> f32 {
    return 2.0 * eta * (abs(q.x) + abs(q.y) + abs(r.x) + abs(r.y)) + 1e-9;
}

fn largest(v: vec3<f32>) -> f32 {
    return max(max(v.x, v.y), v.z);
}

fn smallest(v: vec3<f32>) -> f32 {
    return min(min(v.x, v.y), v.z);
}

fn meet(ray: Ray, at: u32, before: First) -> First {
    var first = before;
    let emitter = given[1].x;
    let words_a = triangles[3u * at];
    let words_b = triangles[3u * at + 1u];
    let words_c = triangles[3u * at + 2u];
    let is_below = any(given[2] == vec4<u32>(at)) || any(given[3] == vec4<u32>(at));
    if words_a.w == emitter || words_b.w == emitter || is_below {
        return first;
    }
    let a = bitcast<vec3<f32>>(words_a.xyz) - ray.start;
    let b = bitcast<vec3<f32>>(words_b.xyz) - ray.start;
    let c = bitcast<vec3<f32>>(words_c.xyz) - ray.start;
    let far = max(largest(abs(a)), max(largest(abs(b)), largest(abs(c))));
    let eta = SLACK * (1.0 + far);
    // The horizon: certainly below it, nothing is met.
    let plane = bitcast<vec4<f32>>(given[0]);
    let height = largest(vec3<f32>(dot(plane.xyz, a), dot(plane.xyz, b), dot(plane.xyz, c))) + ray.height - plane.w;
    if height < -2.0 * eta {
        return first;
    }
    // The triangle as the ray sees it: the start at (0, 0).
    let ta = turned(a, ray.axis);
    let tb = turned(b, ray.axis);
    let tc = turned(c, ray.axis);
    let pa = ta.xy - ray.shear * ta.z;
    let pb = tb.xy - ray.shear * tb.z;
    let pc = tc.xy - ray.shear * tc.z;
    let sides = vec3<f32>(cross_of(pb, pc), cross_of(pc, pa), cross_of(pa, pb));
    let errors = vec3<f32>(error_of(pb, pc, eta), error_of(pc, pa, eta), error_of(pa, pb, eta));
    let over = sides - errors;
    let under = sides + errors;
    // Certainly on either side of two edges: not inside, whatever the winding.
    if largest(over) > 0.0 && smallest(under) < 0.0 {
        return first;
    }
    let depths = ray.sign * vec3<f32>(ta.z, tb.z, tc.z);
    let nearest = smallest(depths);
    let farthest = largest(depths);
    var low = nearest - 2.0 * eta;
    var high = farthest + 2.0 * eta;
    let volume = sides.x + sides.y + sides.z;
    let error = errors.x + errors.y + errors.z;
    if abs(volume) > 2.0 * error {
        let depth = nearest + dot(sides, depths - vec3<f32>(nearest)) / volume;
        // Twice: the place of a plane's crossing that may be outside the triangle errs by as much again.
        let off = 2.0 * error * (farthest - nearest) / (abs(volume) - error) + 2.0 * eta;
        low = max(low, depth - off);
        high = min(high, depth + off);
    }
    if high < 0.0 || low > ray.end * 1.000001 {
        return first;
    }
    let is_within = smallest(over) > 0.0 || largest(under) < 0.0;
    let is_between = low > 0.0 && high < ray.end * 0.999999;
    if is_within && is_between && height > 2.0 * eta {
        // Its front is seen where the way goes against its normal.
        let id = select(words_b.w, words_a.w, volume * ray.sign < 0.0);
        if high < first.high {
            first.others = min(first.others, first.low);
            first.id = id;
            first.low = low;
            first.high = high;
        } else {
            first.others = min(first.others, low);
        }
    } else {
        first.others = min(first.others, low);
    }
    return first;
}

fn first_met(at: u32) -> u32 {
    let ray = ray_of(at);
    if !(ray.end > 0.0) {
        return DOUBTFUL;
    }
    let tie = bitcast<f32>(given[1].z);
    var first = First(NOTHING, NEVER, NEVER, NEVER);
    var stack: array<u32, STACK>;
    stack[0] = 0u;
    var count = 1u;
    var turns = 0u;
    // Places in the stack are held within it, because lavapipe 22.3.6 has lanes that are done go on to read and write.
    while count > 0u {
        count -= 1u;
        turns += 1u;
        let node = stack[min(count, STACK - 1u)];
        let center = nodes[2u * node];
        let half = nodes[2u * node + 1u];
        if !touches(ray, bitcast<vec3<f32>>(center.xyz), bitcast<vec3<f32>>(half.xyz), first.high + tie) {
            continue;
        }
        turns += half.w;
        if turns > MOST_TURNS {
            return DOUBTFUL;
        }
        if half.w > 0u {
            // A leaf: triangles from the first on.
            for (var k = 0u; k < half.w; k += 1u) {
                first = meet(ray, center.w + k, first);
            }
        } else if center.w > 0u {
            if count + 2u > STACK {
                return DOUBTFUL;
            }
            // The nearer child is taken first.
            let ahead = bitcast<vec3<f32>>(nodes[2u * center.w + 2u].xyz) - bitcast<vec3<f32>>(nodes[2u * center.w].xyz);
            let nearer = select(0u, 1u, dot(ahead, ray.way) < 0.0);
            stack[min(count, STACK - 1u)] = center.w + 1u - nearer;
            stack[min(count + 1u, STACK - 1u)] = center.w + nearer;
            count += 2u;
        }
    }
    if first.id == NOTHING {
        return select(DOUBTFUL, NOTHING, first.others == NEVER);
    }
    return select(DOUBTFUL, first.id, first.others > first.high + tie);
}

@compute @workgroup_size(64)
fn cast_rays(@builtin(global_invocation_id) thread: vec3<u32>) {
    if thread.x < given[1].y {
        met[thread.x] = first_met(thread.x);
    }
}
