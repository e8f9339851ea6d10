// Packs the rows of a submission for the host: a header of eight words a slot, then all entries of three words: patch,
// visible weight, weight hidden behind others. One workgroup column a hemicube.

@group(1) @binding(10) var<storage, read_write> tallies: array<u32>;
@group(1) @binding(18) var<storage, read> entries: array<u32>;
@group(1) @binding(21) var<storage, read> totals: array<u32>;
@group(1) @binding(22) var<storage, read> hidden: array<u32>;
@group(1) @binding(23) var<storage, read_write> output: array<u32>;

@compute @workgroup_size(64)
fn pack(
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
) {
    let slot = view.slot + group.y;
    let layer = view.layer + group.y;
    var before = 0u;
    for (var s = 0u; s < slot; s++) {
        before += totals[4u * s];
    }
    let source = layer * settings.capacity;
    let count = totals[4u * slot];
    for (var i = group.x * 64u + local; i < count; i += groups.x * 64u) {
        let target_at = settings.output_entries + 3u * (before + i);
        output[target_at] = entries[2u * (source + i)];
        output[target_at + 1u] = entries[2u * (source + i) + 1u];
        output[target_at + 2u] = hidden[source + i];
    }
    if (group.x == 0u && local < 8u) {
        if (local < 3u) {
            output[8u * slot + local] = totals[4u * slot + local];
        } else {
            output[8u * slot + local] = tallies[8u * layer + local];
            tallies[8u * layer + local] = 0u;
        }
    }
}
