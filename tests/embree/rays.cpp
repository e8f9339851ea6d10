// Casts rays with Intel Embree 3, for the example `accuracy` to hold hemicube against; scripts/embree-rays builds it.
//
// It reads from its standard input, in the order and the width of the machine:
//
//     u32     triangles, patches, emitters, rays of an emitter, the lowest and the highest power of two to cast
//     f64     seconds that a measurement must last
//     each triangle: 9 f32, its corners; u32, the patch in front of it; u32, the patch behind it or NOBODY
//     each emitter:  u32, its patch; then each ray: 6 f32, its origin and its direction
//
// and writes to its standard output, for each power of two:
//
//     f64     seconds of processor time a row, for casting and counting
//     f64     the same with what it takes to lay the rays out, by whichever way and order takes least of both
//     each emitter: u32, how many patches were met; then for each: u32, the patch; u32, the rays that met it
//
// The first 2^k rays of an emitter are the ones that are cast for the power k. In the first, nothing but casting and counting is
// timed: that rays lie ready, and in an order that suits, is a gift. In neither is what it takes to make a ray.
#include <embree3/rtcore.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <limits>
#include <vector>
#ifdef __SSE3__
#include <pmmintrin.h>
#include <xmmintrin.h>
#endif

constexpr uint32_t NOBODY = UINT32_MAX;
/// Where rays begin: the same as for the other caster, so that what one lets through the other does, too.
constexpr float NEAR = 1e-5f;
constexpr float FAR = std::numeric_limits<float>::infinity();
/// How long each way of casting is tried before the fastest is measured.
constexpr double TRIAL_SECONDS = 0.05;
/// Rays that a stream has at once: few enough for them and their hits to stay in the second-level cache.
constexpr uint32_t STREAM = 1024;

[[noreturn]] static void fail(const char* why) {
    std::fprintf(stderr, "error: embree-rays: %s\n", why);
    std::exit(1);
}

template <typename T>
static void take(T* items, size_t count) {
    if (std::fread(items, sizeof(T), count, stdin) != count) fail("the input ends too early");
}

template <typename T>
static void give(const T* items, size_t count) {
    if (std::fwrite(items, sizeof(T), count, stdout) != count) fail("the output cannot be written");
}

static double processor_seconds() {
    timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

struct Ray {
    float of[6];
};
/// Sixteen rays, component by component, as packets want them: filling a packet is then copying whole vectors.
struct alignas(64) Block {
    float of[6][16];
};
struct Sides {
    uint32_t front, back;
};
struct Met {
    uint32_t patch, rays;
};

/// Counts the rays of one row by the patch that they meet.
struct Counter {
    const std::vector<Sides>& sides;
    std::vector<uint32_t> rays;
    std::vector<uint32_t> seen;
    uint32_t emitter = NOBODY;

    /// A hit, if it is one: the triangle, and the cosine (times any length) between its normal and the ray.
    void add(uint32_t triangle, float towards) {
        if (triangle == RTC_INVALID_GEOMETRY_ID) return;
        const uint32_t patch = towards < 0.0f ? sides[triangle].front : sides[triangle].back;
        // A patch does not see itself; single precision has some rays meet the triangle that they leave.
        if (patch == NOBODY || patch == emitter) return;
        if (rays[patch]++ == 0) seen.push_back(patch);
    }
};

struct Caster {
    RTCScene scene;
    RTCIntersectContext context;
    Counter counter;

    /// One ray at a time.
    void single(const Block* blocks, uint32_t count) {
        for (uint32_t k = 0; k < count; ++k) {
            RTCRayHit one;
            load(one, blocks[k / 16], k % 16);
            rtcIntersect1(scene, &context, &one);
            counter.add(one.hit.primID, towards(one));
        }
    }

    /// Packets of eight or sixteen.
    template <uint32_t WIDTH, typename Packet, typename Intersect>
    void packets(const Block* blocks, uint32_t count, Intersect intersect) {
        alignas(64) int valid[WIDTH];
        std::fill_n(valid, WIDTH, -1);
        for (uint32_t k = 0; k < count; k += WIDTH) {
            const auto& of = blocks[k / 16].of;
            const uint32_t first = k % 16;
            Packet p;
            auto& r = p.ray;
            float* to[6] = {r.org_x, r.org_y, r.org_z, r.dir_x, r.dir_y, r.dir_z};
            for (int c = 0; c < 6; ++c) std::copy_n(of[c] + first, WIDTH, to[c]);
            std::fill_n(r.tnear, WIDTH, NEAR);
            std::fill_n(r.tfar, WIDTH, FAR);
            std::fill_n(r.time, WIDTH, 0.0f);
            std::fill_n(r.mask, WIDTH, UINT32_MAX);
            std::fill_n(r.flags, WIDTH, 0u);
            std::fill_n(p.hit.geomID, WIDTH, RTC_INVALID_GEOMETRY_ID);
            std::fill_n(p.hit.primID, WIDTH, RTC_INVALID_GEOMETRY_ID);
            std::fill_n(p.hit.instID[0], WIDTH, RTC_INVALID_GEOMETRY_ID);
            intersect(valid, scene, &context, &p);
            for (uint32_t i = 0; i < WIDTH; ++i)
                counter.add(p.hit.primID[i], p.hit.Ng_x[i] * r.dir_x[i] + p.hit.Ng_y[i] * r.dir_y[i] + p.hit.Ng_z[i] * r.dir_z[i]);
        }
    }

    /// Streams, which Embree cuts into packets as it likes.
    void streams(const Block* blocks, uint32_t count) {
        static RTCRayHit many[STREAM];
        for (uint32_t k = 0; k < count; k += STREAM) {
            const uint32_t here = std::min(STREAM, count - k);
            for (uint32_t i = 0; i < here; ++i) load(many[i], blocks[(k + i) / 16], (k + i) % 16);
            rtcIntersect1M(scene, &context, many, here, sizeof(RTCRayHit));
            for (uint32_t i = 0; i < here; ++i) counter.add(many[i].hit.primID, towards(many[i]));
        }
    }

    static void load(RTCRayHit& one, const Block& block, uint32_t at) {
        const auto& of = block.of;
        one.ray = {of[0][at], of[1][at], of[2][at], NEAR, of[3][at], of[4][at], of[5][at], 0.0f, FAR, UINT32_MAX, 0, 0};
        one.hit.geomID = one.hit.primID = one.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    }

    static float towards(const RTCRayHit& one) {
        return one.hit.Ng_x * one.ray.dir_x + one.hit.Ng_y * one.ray.dir_y + one.hit.Ng_z * one.ray.dir_z;
    }
};

struct Way {
    const char* name;
    RTCIntersectContextFlags flags;
    void (*cast)(Caster&, const Block*, uint32_t);
};

static void cast8(Caster& c, const Block* b, uint32_t n) { c.packets<8, RTCRayHit8>(b, n, rtcIntersect8); }
static void cast16(Caster& c, const Block* b, uint32_t n) { c.packets<16, RTCRayHit16>(b, n, rtcIntersect16); }
static void cast1(Caster& c, const Block* b, uint32_t n) { c.single(b, n); }
static void cast1m(Caster& c, const Block* b, uint32_t n) { c.streams(b, n); }

constexpr auto INCOHERENT = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
constexpr auto COHERENT = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
constexpr Way WAYS[] = {
    {"1", INCOHERENT, cast1},
    {"8", INCOHERENT, cast8},
    {"8 coherent", COHERENT, cast8},
    {"16", INCOHERENT, cast16},
    {"16 coherent", COHERENT, cast16},
    {"1M", INCOHERENT, cast1m},
    {"1M coherent", COHERENT, cast1m},
};

/// A key by which directions that are near each other are near in order: the bits of the components, interleaved.
static uint32_t key(const Ray& ray) {
    uint32_t key = 0;
    for (int c = 0; c < 3; ++c) {
        const auto cell = uint32_t(std::clamp((ray.of[3 + c] + 1.0f) * 512.0f, 0.0f, 1023.0f));
        for (int bit = 0; bit < 10; ++bit) key |= (cell >> bit & 1) << (3 * bit + c);
    }
    return key;
}

/// The first rays of an emitter, in blocks; by direction if so wanted, for packets to go one way through the hierarchy.
static void arrange(const Ray* rays, uint32_t count, bool by_direction, Block* blocks) {
    std::vector<std::pair<uint32_t, uint32_t>> order(count);
    for (uint32_t k = 0; k < count; ++k) order[k] = {by_direction ? key(rays[k]) : 0, k};
    if (by_direction) std::sort(order.begin(), order.end());
    for (uint32_t k = 0; k < count; ++k)
        for (int c = 0; c < 6; ++c) blocks[k / 16].of[c][k % 16] = rays[order[k].second].of[c];
}

int main() {
    uint32_t head[6];
    take(head, 6);
    const uint32_t triangles = head[0], patches = head[1], emitters = head[2];
    const uint32_t rays_each = head[3], lowest = head[4], highest = head[5];
    double enough;
    take(&enough, 1);
    // Whole blocks, and no more rays than there are.
    if (lowest < 4 || highest > 31 || lowest > highest || (1u << highest) > rays_each) fail("no such powers of two");

#ifdef __SSE3__
    // Embree asks for this of every thread that casts.
    _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
    _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
#endif
    // One thread, as for what it is held against; and registers as wide as the processor has.
    RTCDevice device = rtcNewDevice("threads=1,frequency_level=simd512");
    if (!device) fail("Embree makes no device");
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* corners = static_cast<float*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), size_t(3) * triangles));
    auto* indices = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(uint32_t), triangles));
    if (!corners || !indices) fail("Embree has no memory for the triangles");
    std::vector<Sides> sides(triangles);
    for (uint32_t t = 0; t < triangles; ++t) {
        take(corners + size_t(9) * t, 9);
        take(&sides[t], 1);
        for (uint32_t c = 0; c < 3; ++c) indices[3 * t + c] = 3 * t + c;
    }
    rtcCommitGeometry(geometry);
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
    rtcAttachGeometry(scene, geometry);
    rtcCommitScene(scene);
    if (rtcGetDeviceError(device) != RTC_ERROR_NONE) fail("Embree cannot build the scene");

    std::vector<uint32_t> emitter(emitters);
    std::vector<Ray> rays(size_t(emitters) * rays_each);
    for (uint32_t e = 0; e < emitters; ++e) {
        take(&emitter[e], 1);
        take(&rays[size_t(e) * rays_each], rays_each);
    }

    Caster caster{scene, {}, {sides, std::vector<uint32_t>(patches), {}}};
    std::vector<std::vector<Met>> rows(emitters);
    for (uint32_t power = lowest; power <= highest; ++power) {
        const uint32_t count = 1u << power;
        std::vector<Block> blocks(size_t(emitters) * count / 16);
        const auto lay_out = [&](bool by_direction) {
            for (uint32_t e = 0; e < emitters; ++e)
                arrange(&rays[size_t(e) * rays_each], count, by_direction, &blocks[size_t(e) * count / 16]);
        };
        // Seconds a row, from as many rounds over all the rows as last so long.
        const auto measure = [&](const Way& way, double least) {
            rtcInitIntersectContext(&caster.context);
            caster.context.flags = way.flags;
            const double began = processor_seconds();
            for (uint32_t rounds = 1;; ++rounds) {
                for (uint32_t e = 0; e < emitters; ++e) {
                    caster.counter.emitter = emitter[e];
                    way.cast(caster, &blocks[size_t(e) * count / 16], count);
                    std::sort(caster.counter.seen.begin(), caster.counter.seen.end());
                    rows[e].clear();
                    for (uint32_t patch : caster.counter.seen) {
                        rows[e].push_back({patch, caster.counter.rays[patch]});
                        caster.counter.rays[patch] = 0;
                    }
                    caster.counter.seen.clear();
                }
                const double elapsed = processor_seconds() - began;
                if (elapsed >= least) return elapsed / rounds / emitters;
            }
        };

        std::fprintf(stderr, "Embree, 2^%u rays, ms a row:", power);
        double fastest = std::numeric_limits<double>::infinity(), whole = fastest;
        const Way* chosen = nullptr;
        bool chosen_order = false;
        for (bool by_direction : {false, true}) {
            const double began = processor_seconds();
            lay_out(by_direction);
            const double ordering = (processor_seconds() - began) / emitters;
            std::fprintf(stderr, by_direction ? "; by direction (ordering %.3f)" : " as they come (copying %.3f)", 1e3 * ordering);
            for (const Way& way : WAYS) {
                const double seconds = measure(way, TRIAL_SECONDS);
                std::fprintf(stderr, ", %s %.3f", way.name, 1e3 * seconds);
                whole = std::min(whole, ordering + seconds);
                if (seconds < fastest) fastest = seconds, chosen = &way, chosen_order = by_direction;
            }
        }
        lay_out(chosen_order);
        const double seconds = measure(*chosen, enough);
        std::fprintf(stderr, "; fastest: %s%s, %.3f\n", chosen->name, chosen_order ? " by direction" : "", 1e3 * seconds);

        give(&seconds, 1);
        give(&whole, 1);
        for (const auto& row : rows) {
            const auto length = uint32_t(row.size());
            give(&length, 1);
            give(row.data(), length);
        }
    }
    if (std::fflush(stdout) != 0) fail("the output cannot be written");
    rtcReleaseGeometry(geometry);
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
}
