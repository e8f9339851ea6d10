/* The smallest backend in C: a ray through every pixel of a hemicube, held against every surface.
 *
 *   cc -O2 -shared -fPIC -I crates/backends/abi/include backend.c -o libhemicube_backend_c_minimal.so
 */
#include "hemicube_backend.h"
#include <stdlib.h>
#include <string.h>

struct HcSession { HcScene scene; uint32_t n; uint32_t *weights, *items; double *corners; uint32_t *front, *back; };

static void *copy(const void *from, size_t size) { void *to = malloc(size ? size : 1); return to && size ? memcpy(to, from, size) : to; }
static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static void cross(const double *a, const double *b, double *c) {
    c[0] = a[1] * b[2] - a[2] * b[1]; c[1] = a[2] * b[0] - a[0] * b[2]; c[2] = a[0] * b[1] - a[1] * b[0];
}

static HcStatus devices(HcDevice *out, uint32_t capacity, uint32_t *count, HcError *error) {
    (void)error;
    if (capacity > 0) {
        memset(out, 0, sizeof *out);
        strcpy(out->name, "one processor core");
        out->capabilities = HC_CAN_ITEMS | HC_CAN_LOSSLESS_CULLING;
        out->kind = HC_DEVICE_SOFTWARE;
        out->max_resolution = 1024;
        out->preferred_rows = 4;
    }
    *count = 1;
    return HC_OK;
}

static HcStatus open(const HcHost *host, uint32_t device, const char *options, HcSession **session, HcError *error) {
    (void)host, (void)device;
    if (options && *options) { strcpy(error->message, "there are no options"); return HC_ERROR_INVALID_ARGUMENT; }
    *session = calloc(1, sizeof **session);
    return *session ? HC_OK : HC_ERROR_OUT_OF_MEMORY;
}

static void drop(HcSession *s) { free(s->weights); free(s->items); free(s->corners); free(s->front); free(s->back); }
static void close(HcSession *s) { drop(s); free(s); }

static HcStatus load(HcSession *s, const HcScene *scene, const HcSettings *settings, HcError *error) {
    size_t count = scene->surface_count, pixels = 3 * (size_t)settings->resolution * settings->resolution;
    drop(s);
    s->scene = *scene;
    s->n = settings->resolution;
    s->weights = copy(settings->weights, pixels * sizeof(uint32_t));
    s->items = malloc(pixels * sizeof(uint32_t));
    s->corners = copy(scene->corners, count * 9 * sizeof(double));
    s->front = copy(scene->front, count * sizeof(uint32_t));
    s->back = copy(scene->back, count * sizeof(uint32_t));
    if (s->weights && s->items && s->corners && s->front && s->back) return HC_OK;
    strcpy(error->message, "the scene does not fit into memory");
    return HC_ERROR_OUT_OF_MEMORY;
}

/* What a ray meets first; the smaller patch where depths are equal. */
static uint32_t first(const HcSession *s, const HcHemicube *h, const double *ray) {
    uint32_t nearest = HC_ESCAPED;
    double nearest_depth = 1e300;
    for (size_t k = 0; k < s->scene.surface_count; k++) { /* Moeller & Trumbore 1997 */
        const double *c = s->corners + 9 * k;
        double ab[3], ac[3], from[3], p[3], q[3];
        if (h->emitter != HC_NO_PATCH && (s->front[k] == h->emitter || s->back[k] == h->emitter)) continue;
        for (int i = 0; i < 3; i++) { ab[i] = c[3 + i] - c[i]; ac[i] = c[6 + i] - c[i]; from[i] = h->origin[i] - c[i]; }
        cross(ray, ac, p); cross(from, ab, q);
        double det = dot(ab, p), u = dot(from, p) / det, v = dot(ray, q) / det, depth = dot(ac, q) / det;
        uint32_t patch = det > 0 ? s->front[k] : s->back[k] == HC_NO_PATCH ? HC_BLOCKED : s->back[k];
        if (!(u >= 0 && v >= 0 && u + v <= 1 && depth > s->scene.plane_tolerance)) continue;
        if (depth < nearest_depth || (depth == nearest_depth && patch < nearest)) { nearest_depth = depth; nearest = patch; }
    }
    return nearest;
}

static HcStatus items(HcSession *s, const HcHemicube *h, uint32_t *items, HcError *error) {
    static const int axis[5][3] = {{0, 1, 2}, {1, 2, 0}, {1, 2, 0}, {0, 2, 1}, {0, 2, 1}};
    static const double sign[5][3] = {{1, 1, 1}, {1, 1, 1}, {-1, 1, -1}, {-1, 1, 1}, {1, 1, -1}};
    (void)error;
    for (uint32_t face = 0; face < 5; face++)
        for (uint32_t y = 0; y < (face ? s->n / 2 : s->n); y++)
            for (uint32_t x = 0; x < s->n; x++) {
                double face_ray[3] = {(x + 0.5) * 2 / s->n - 1, (y + 0.5) * 2 / s->n - (face ? 0 : 1), 1}, ray[3] = {0, 0, 0};
                for (int k = 0; k < 3; k++)
                    for (int i = 0; i < 3; i++) ray[i] += h->axes[3 * axis[face][k] + i] * face_ray[k] * sign[face][k];
                *items++ = first(s, h, ray);
            }
    return HC_OK;
}

static HcStatus rows(HcSession *s, HcRows *rows, HcError *error) {
    size_t pixels = 3 * (size_t)s->n * s->n, end = 0;
    uint32_t *row = malloc((s->scene.patch_count + (size_t)1) * sizeof *row), *pixel = s->items;
    if (!row) return HC_ERROR_OUT_OF_MEMORY;
    for (uint32_t r = 0; r < rows->row_count; r++) {
        rows->escaped[r] = rows->blocked[r] = 0;
        memset(row, 0, s->scene.patch_count * sizeof *row);
        items(s, rows->hemicubes + r, pixel, error);
        for (size_t k = 0; k < pixels; k++)
            *(pixel[k] == HC_ESCAPED ? rows->escaped + r : pixel[k] == HC_BLOCKED ? rows->blocked + r : row + pixel[k]) += s->weights[k];
        for (uint32_t patch = 0; patch < s->scene.patch_count; patch++)
            if (row[patch]) { rows->patches[end] = patch; rows->visible[end++] = row[patch]; }
        rows->row_end[r] = end;
    }
    rows->counters.hemicubes = rows->row_count;
    free(row);
    return HC_OK;
}

HC_EXPORT const HcBackend hemicube_backend = {
    HC_ABI_VERSION, sizeof(HcBackend), "c-minimal", "1", devices, open, NULL, load, rows, items, close, NULL, NULL,
};
