// Triangles with exact edges: put before the stages that decide on pixel centres.

// The sum of three products, with explicit fused multiply-adds: a compiler's own fusing could lose the exact change of
// sign.
fn dot_fused(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z));
}

// Turns over exactly when one of the two does.
fn cross_fused(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(
        fma(a.y, b.z, -(a.z * b.y)),
        fma(a.z, b.x, -(a.x * b.z)),
        fma(a.x, b.y, -(a.y * b.x)),
    );
}

fn high_of(c: Vertex) -> vec3<f32> {
    return vec3<f32>(c.high_x, c.high_y, c.high_z);
}

fn low_of(c: Vertex) -> vec3<f32> {
    return vec3<f32>(c.low_x, c.low_y, c.low_z);
}

// An edge's side of a direction: above 0 inside, and on the edge itself above 0 for one of the two triangles sharing
// it, by its own direction.
fn side_of(edge: vec3<f32>, direction: vec3<f32>) -> f32 {
    let side = dot_fused(edge, direction);
    let first = select(select(edge.z, edge.y, edge.y != 0.0), edge.x, edge.x != 0.0);
    return select(side, first, side == 0.0);
}

// The axes of a face, along those of the scene: all signs and zeros of its projection are exact.
struct Axes {
    right: vec3<f32>,
    up: vec3<f32>,
    forward: vec3<f32>,
    is_top: bool,
}

fn axes_of(v: View) -> Axes {
    // A side's clip_y is 2 up - forward.
    let is_top = v.face == 0u;
    let up = select(0.5 * (v.clip_y + v.clip_w), v.clip_y, is_top);
    return Axes(
        v.clip_x.x * v.tangent + v.clip_x.y * v.bitangent + v.clip_x.z * v.normal,
        up.x * v.tangent + up.y * v.bitangent + up.z * v.normal,
        v.clip_w.x * v.tangent + v.clip_w.y * v.bitangent + v.clip_w.z * v.normal,
        is_top,
    );
}

fn along(a: Axes, d: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot_fused(a.right, d), dot_fused(a.up, d), dot_fused(a.forward, d));
}

// The height of a point of a face above the emitter's plane.
fn height_of(a: Axes, p: vec3<f32>) -> f32 {
    return select(p.y, p.z, a.is_top);
}

fn with_height(a: Axes, p: vec3<f32>, height: f32) -> vec3<f32> {
    return select(vec3<f32>(p.x, height, p.z), vec3<f32>(p.xy, height), a.is_top);
}

// A corner along the axes of a face: `placed` of the settle stage, to the bit.
fn corner_on(v: View, a: Axes, c: Vertex) -> vec3<f32> {
    let p = along(a, (high_of(c) - v.eye_high) + (low_of(c) - v.eye_low));
    let height = height_of(a, p);
    let snap = fma(abs(p.x) + abs(select(p.z, p.y, a.is_top)), 9.5367431640625e-7, v.tolerance);
    return with_height(a, p, select(height, 0.0, abs(height) <= snap));
}

// The vector from one corner to another: `between` of the settle stage, to the bit.
fn side_on(a: Axes, c: Vertex, d: Vertex, from_place: vec3<f32>, to_place: vec3<f32>) -> vec3<f32> {
    let s = along(a, (high_of(d) - high_of(c)) + (low_of(d) - low_of(c)));
    let low = height_of(a, from_place);
    let high = height_of(a, to_place);
    return with_height(a, s, select(height_of(a, s), high - low, low == 0.0 || high == 0.0));
}

// A triangle along the axes of a face.
struct Outline {
    corners: array<vec3<f32>, 3>,
    // Normals of the planes through the eye and a side, inwards.
    sides: array<vec3<f32>, 3>,
    // The product of its corners: above 0 if the eye sees the back.
    volume: f32,
}

fn outline(v: View, axes: Axes, a: Vertex, b: Vertex, c: Vertex) -> Outline {
    let p = corner_on(v, axes, a);
    let q = corner_on(v, axes, b);
    let r = corner_on(v, axes, c);
    let to_q = side_on(axes, a, b, p, q);
    let to_r = side_on(axes, b, c, q, r);
    let to_p = side_on(axes, c, a, r, p);
    let volume = dot_fused(cross_fused(to_q, to_r), p);
    let turn = select(-1.0, 1.0, volume > 0.0);
    // Twice the product of the ends, from terms that change sign exactly when the ends change places.
    let sides = array<vec3<f32>, 3>(
        turn * cross_fused(p + q, to_q),
        turn * cross_fused(q + r, to_r),
        turn * cross_fused(r + p, to_p),
    );
    return Outline(array<vec3<f32>, 3>(p, q, r), sides, volume);
}
