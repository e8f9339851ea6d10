// Lists the entries of each row, ascending, and clears the dense arrays it read to 0. One workgroup a hemicube.

@group(1) @binding(8) var<storage, read_write> seen: array<u32>;
@group(1) @binding(13) var<storage, read_write> visible: array<u32>;
@group(1) @binding(14) var<storage, read_write> touched: array<u32>;
// Two words an entry: patch, visible weight. [layer][capacity].
@group(1) @binding(18) var<storage, read_write> entries: array<u32>;
@group(1) @binding(19) var<storage, read> chunk_of_patch: array<u32>;
// Four words a layer: an indirect draw of three corners for each entry.
@group(1) @binding(20) var<storage, read_write> cover_draws: array<u32>;
// Four words a slot: entries, escaped, blocked, 0.
@group(1) @binding(21) var<storage, read_write> totals: array<u32>;
// The weight of an entry's hidden pixels. [layer][capacity].
@group(1) @binding(22) var<storage, read_write> hidden: array<u32>;

const GROUP: u32 = 256u;

var<workgroup> counts: array<u32, GROUP>;

@compute @workgroup_size(GROUP)
fn compact(@builtin(local_invocation_index) local: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let slot = view.slot + group.x;
    let layer = view.layer + group.x;
    let each = (settings.word_count + GROUP - 1u) / GROUP;
    let first = min(local * each, settings.word_count);
    let end = min(first + each, settings.word_count);
    let words = layer * settings.word_count;
    var count = 0u;
    for (var w = first; w < end; w++) {
        count += countOneBits(touched[words + w]);
    }
    counts[local] = count;
    workgroupBarrier();
    // Sixteen threads add up sixteen counts each, then every thread adds the sum before it.
    var before = 0u;
    for (var i = local & ~15u; i < local; i++) {
        before += counts[i];
    }
    workgroupBarrier();
    if ((local & 15u) == 15u) {
        counts[local] = before + count;
    }
    workgroupBarrier();
    for (var i = 15u; i < (local & ~15u); i += 16u) {
        before += counts[i];
    }
    let weights = layer * (settings.patch_count + 2u);
    if (local == GROUP - 1u) {
        let all = before + count;
        totals[4u * slot] = all;
        totals[4u * slot + 1u] = visible[weights + settings.patch_count + 1u];
        totals[4u * slot + 2u] = visible[weights + settings.patch_count];
        totals[4u * slot + 3u] = 0u;
        visible[weights + settings.patch_count + 1u] = 0u;
        visible[weights + settings.patch_count] = 0u;
        cover_draws[4u * layer] = 3u * all;
        cover_draws[4u * layer + 1u] = 1u;
        cover_draws[4u * layer + 2u] = 0u;
        cover_draws[4u * layer + 3u] = 0u;
        if (group.x == 0u) {
            visible[settings.queue] = 0u;
        }
    }
    var at = layer * settings.capacity + before;
    for (var w = first; w < end; w++) {
        var word = touched[words + w];
        if (word == 0u) {
            continue;
        }
        touched[words + w] = 0u;
        while (word != 0u) {
            let id = w * 32u + firstTrailingBit(word);
            word &= word - 1u;
            entries[2u * at] = id;
            entries[2u * at + 1u] = visible[weights + id];
            hidden[at] = 0u;
            at += 1u;
            visible[weights + id] = 0u;
            seen[chunk_of_patch[id]] = view.stamp;
        }
    }
}
