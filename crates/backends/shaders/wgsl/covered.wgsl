// Adds the weight of a row's patches where something else is seen: the cover stage of `draw=compute`. A thread has an
// entry; small ones it counts alone, large ones all threads of its workgroup.

@group(1) @binding(11) var items: texture_2d_array<u32>;
@group(1) @binding(12) var<storage, read> weights: array<u32>;
@group(1) @binding(15) var<storage, read> vertices: array<Vertex>;
@group(1) @binding(16) var<storage, read> indices: array<u32>;
@group(1) @binding(17) var<storage, read> triangle_of_patch: array<u32>;
@group(1) @binding(18) var<storage, read> entries: array<u32>;
@group(1) @binding(21) var<storage, read> totals: array<u32>;
@group(1) @binding(22) var<storage, read_write> hidden: array<atomic<u32>>;

const GROUP: u32 = 64u;
// Pixels of a box that a thread looks at alone.
const FEW: u32 = 64u;

// Entries and faces with more pixels.
var<workgroup> many: array<vec2<u32>, 320>;
var<workgroup> many_count: atomic<u32>;

// The pixels of a face that a triangle may cover: x, y of the first, x, y of one past the last.
fn box_of(v: View, t: Outline) -> vec4<u32> {
    let n = f32(settings.resolution);
    let size = vec2<f32>(n, f32(v.rows));
    let z = vec3<f32>(t.corners[0].z, t.corners[1].z, t.corners[2].z);
    if (t.volume == 0.0 || max(max(z.x, z.y), z.z) <= 0.0) {
        return vec4<u32>(0u);
    }
    if (min(min(z.x, z.y), z.z) <= 0.0) {
        return vec4<u32>(vec2<u32>(0u), vec2<u32>(size));
    }
    let p = t.corners[0].xy / z.x;
    let q = t.corners[1].xy / z.y;
    let r = t.corners[2].xy / z.z;
    // A pixel's centre at whole numbers, and a little more than rounding.
    let shift = vec2<f32>(n, select(0.0, n, v.face == 0u)) * 0.5 - 0.5;
    let low = ceil(clamp(min(min(p, q), r) * (0.5 * n) + shift - 0.01, vec2<f32>(0.0), size));
    let high = floor(clamp(max(max(p, q), r) * (0.5 * n) + shift + 1.01, vec2<f32>(0.0), size));
    return vec4<u32>(vec2<u32>(low), vec2<u32>(max(low, high)));
}

// The weight of the pixels of a box, from a number on in steps, where a triangle is hidden by something else.
fn hidden_in(v: View, t: Outline, box: vec4<u32>, id: u32, first: u32, step: u32) -> u32 {
    let n = settings.resolution;
    let wide = box.z - box.x;
    let all = wide * (box.w - box.y);
    let shift = vec2<i32>(vec2<u32>(n, select(0u, n, v.face == 0u)));
    var sum = 0u;
    for (var i = first; i < all; i += step) {
        let at = box.xy + vec2<u32>(i % wide, i / wide);
        let direction = vec3<f32>(vec2<f32>(vec2<i32>(2u * at + 1u) - shift), f32(n));
        let inside = side_of(t.sides[0], direction) > 0.0
            && side_of(t.sides[1], direction) > 0.0
            && side_of(t.sides[2], direction) > 0.0;
        if (inside) {
            let there = vec2<u32>(at.x, at.y + v.first_row);
            if (textureLoad(items, vec2<i32>(there), i32(v.layer), 0).x != id) {
                sum += weights[there.y * n + there.x];
            }
        }
    }
    return sum;
}

fn outline_of(v: View, id: u32) -> Outline {
    let corner = 3u * triangle_of_patch[id];
    return outline(
        v,
        axes_of(v),
        vertices[indices[corner]],
        vertices[indices[corner + 1u]],
        vertices[indices[corner + 2u]],
    );
}

// Groups: any number, layers.
@compute @workgroup_size(GROUP)
fn cover_tiles(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let slot = view.slot + group.y;
    let base = (view.layer + group.y) * settings.capacity;
    let count = totals[4u * slot];
    for (var begin = group.x * GROUP; begin < count; begin += groups.x * GROUP) {
        if (local == 0u) {
            atomicStore(&many_count, 0u);
        }
        workgroupBarrier();
        let entry = begin + local;
        if (entry < count) {
            let id = entries[2u * (base + entry)];
            var sum = 0u;
            for (var face = 0u; face < 5u; face++) {
                let v = views[slot * 5u + face];
                let t = outline_of(v, id);
                let box = box_of(v, t);
                if ((box.z - box.x) * (box.w - box.y) > FEW) {
                    many[atomicAdd(&many_count, 1u)] = vec2<u32>(entry, face);
                } else {
                    sum += hidden_in(v, t, box, id, 0u, 1u);
                }
            }
            atomicAdd(&hidden[base + entry], sum);
        }
        workgroupBarrier();
        let large = atomicLoad(&many_count);
        for (var i = 0u; i < large; i++) {
            let id = entries[2u * (base + many[i].x)];
            let v = views[slot * 5u + many[i].y];
            let t = outline_of(v, id);
            atomicAdd(&hidden[base + many[i].x], hidden_in(v, t, box_of(v, t), id, local, GROUP));
        }
        workgroupBarrier();
    }
}
