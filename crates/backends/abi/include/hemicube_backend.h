/* The ABI of hemicube backends loaded at run time.
 * Generated from crates/backends/abi/src/types.rs: do not edit.
 */

#ifndef HEMICUBE_BACKEND_H
#define HEMICUBE_BACKEND_H


#include <stdint.h>

typedef struct HcSession HcSession;

/* Put before the definition of `hemicube_backend`. */
#if defined(_WIN32)
#define HC_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define HC_EXPORT __attribute__((visibility("default")))
#else
#define HC_EXPORT
#endif

/*
 Version of the ABI. A host loads a plugin only when the two are equal; within a version things are only appended.
 */
#define HC_ABI_VERSION 1

/*
 Weight of a whole hemicube: a form factor is a weight divided by this. The weights of a hemicube's visible patches
 and its escaped and blocked weight sum to exactly this.
 */
#define HC_WHOLE 2147483648

/*
 In place of a missing patch number: the emitter of a free point, the back of a one-sided surface.
 */
#define HC_NO_PATCH 4294967295

/*
 In an item buffer: the pixel hit nothing.
 */
#define HC_ESCAPED 4294967295

/*
 In an item buffer: the pixel hit the back of a one-sided surface.
 */
#define HC_BLOCKED 4294967294

/*
 The answer to a ray that has no certain one.
 */
#define HC_DOUBTFUL 4294967293

/*
 Parent of an octree's root.
 */
#define HC_NO_NODE 4294967295

/*
 Done.
 */
#define HC_OK 0

/*
 A request against the contract. The session stays usable.
 */
#define HC_ERROR_INVALID_ARGUMENT 1

/*
 A legal request beyond this backend. The session stays usable.
 */
#define HC_ERROR_UNSUPPORTED 2

/*
 Host or device memory ran out. The session stays usable.
 */
#define HC_ERROR_OUT_OF_MEMORY 3

/*
 The device is gone. Only `close` may follow.
 */
#define HC_ERROR_DEVICE_LOST 4

/*
 A defect of the backend, like every number not in this list. Only `close` may follow.
 */
#define HC_ERROR_INTERNAL 5

/*
 A panic or an exception, caught at the boundary. Only `close` may follow.
 */
#define HC_ERROR_PANIC 6

/*
 Fills in covered weights when asked.
 */
#define HC_CAN_COVERED 1

/*
 Reports patches without a pixel centre but nearest at their centroid, if covered weights are asked for.
 */
#define HC_CAN_TINY_PATCHES 2

/*
 `items` works.
 */
#define HC_CAN_ITEMS 4

/*
 Rows with culling on and off are the same bits.
 */
#define HC_CAN_LOSSLESS_CULLING 8

/*
 `pass` works.
 */
#define HC_CAN_PASSES 16

/*
 Hemicubes with a surface above their plane and within 2⁻¹⁸ normalised units of their origin may be wrong: the host
 has them drawn on the processor. A host that does not know this bit asks for them all the same.
 */
#define HC_LEAVES_CLOSE 32

/*
 `rays` works.
 */
#define HC_CAN_RAYS 64

/*
 A device of none of the kinds below.
 */
#define HC_DEVICE_OTHER 0

/*
 A processor, or a graphics driver running on one. `--backend auto` prefers the built-in backend to it.
 */
#define HC_DEVICE_SOFTWARE 1

/*
 A GPU sharing the processor's memory.
 */
#define HC_DEVICE_INTEGRATED_GPU 2

/*
 A GPU with memory of its own.
 */
#define HC_DEVICE_DISCRETE_GPU 3

/*
 A GPU handed through to a virtual machine.
 */
#define HC_DEVICE_VIRTUAL_GPU 4

/*
 An error of the program or the plugin.
 */
#define HC_LOG_ERROR 1

/*
 News that a user should know.
 */
#define HC_LOG_WARN 2

/*
 News that a user may want to know.
 */
#define HC_LOG_INFO 3

/*
 Details for finding a defect.
 */
#define HC_LOG_DEBUG 4

/*
 `HC_OK` or an `HC_ERROR_…`. An integer, not an enum: any number may come from foreign code.
 */
typedef int32_t HcStatus;

/*
 A device for sessions. Stands in arrays, so it does not grow.
 */
typedef struct HcDevice {
  /*
   Name and driver in words, UTF-8 and NUL-terminated.
   */
  char name[128];
  /*
   `HC_CAN_…` bits.
   */
  uint64_t capabilities;
  /*
   `HC_DEVICE_…`.
   */
  uint32_t kind;
  /*
   Its largest resolution: a multiple of 16 from 16 to 1024.
   */
  uint32_t max_resolution;
  /*
   Preferred number of hemicubes a call; 0 counts for 1.
   */
  uint32_t preferred_rows;
  /*
   Zero.
   */
  uint32_t reserved[9];
} HcDevice;

/*
 Message of a failed call, UTF-8 and NUL-terminated, cut to fit. Zeroed by the host.
 */
typedef struct HcError {
  /*
   The message.
   */
  char message[512];
} HcError;

/*
 The host's services. The struct is valid until `open` returns; `context` and `log` live for the whole process.
 */
typedef struct HcHost {
  /*
   Bytes of this struct.
   */
  uint32_t struct_size;
  /*
   Zero.
   */
  uint32_t reserved;
  /*
   To be handed back to `log`.
   */
  void *context;
  /*
   Says something, `level` one of `HC_LOG_…`, `message` UTF-8. [any-thread] May be NULL.
   */
  void (*log)(void *context, int32_t level, const char *message);
} HcHost;

/*
 Details of a session beyond its device's entry: filled by `info`.
 */
typedef struct HcSessionInfo {
  /*
   Bytes of this struct.
   */
  uint32_t struct_size;
  /*
   See `HcDevice`; for this session.
   */
  uint32_t preferred_rows;
  /*
   See `HcDevice`; for this session.
   */
  uint64_t capabilities;
  /*
   The device, in words.
   */
  char device[128];
  /*
   Version of the arithmetic: matrices of different versions are not mixed. May depend on the loaded scene.
   */
  char version[64];
  /*
   Choices made for the loaded scene and their reasons, a line each. May be empty.
   */
  char choices[1024];
} HcSessionInfo;

/*
 A node of the octree: a range of surfaces. Stands in arrays, so it does not grow.

 Own surfaces come first in the range, then the children's, each child's a contiguous range.
 */
typedef struct HcNode {
  /*
   Smallest box over all surfaces beneath this node.
   */
  double min[3];
  /*
   Its other corner.
   */
  double max[3];
  /*
   Smallest box over the node's own surfaces; `own_min` above `own_max` if there are none.
   */
  double own_min[3];
  /*
   Its other corner.
   */
  double own_max[3];
  /*
   First surface beneath this node.
   */
  uint32_t first_surface;
  /*
   One past the last of the node's own surfaces.
   */
  uint32_t own_end;
  /*
   One past the last surface beneath this node.
   */
  uint32_t surface_end;
  /*
   First child, a node number; children are beside each other.
   */
  uint32_t first_child;
  /*
   Number of children; 0 for a leaf.
   */
  uint32_t child_count;
  /*
   The node's parent; `HC_NO_NODE` for the root, the first node.
   */
  uint32_t parent;
  /*
   The node's cell, counted from the cube's origin in cells of its level.
   */
  uint32_t cell[3];
  /*
   Level of the cell; 0 is the whole cube.
   */
  uint32_t level;
} HcNode;

/*
 A scene. Coordinates are normalised: the middle of the scene's box is the origin, and its longest half side lies in
 (1/2, 1].
 */
typedef struct HcScene {
  /*
   Bytes of this struct.
   */
  uint32_t struct_size;
  /*
   Number of patches, numbered from 0.
   */
  uint32_t patch_count;
  /*
   Not 0: another call of `load` with this number brings the same scene, bit for bit; sessions can share everything
   derived from it. 0: nothing is known.
   */
  uint64_t identity;
  /*
   A corner nearer than this to the emitter's plane counts for lying in it.
   */
  double plane_tolerance;
  /*
   Number of surfaces.
   */
  uint64_t surface_count;
  /*
   Nine numbers a surface: three corners, counter-clockwise seen from the front. In the octree's order.
   */
  const double *corners;
  /*
   Patch on the front of each surface.
   */
  const uint32_t *front;
  /*
   Patch on the back of each surface; `HC_NO_PATCH` for a one-sided one: its back blocks.
   */
  const uint32_t *back;
  /*
   Number of nodes of the octree.
   */
  uint64_t node_count;
  /*
   The octree, breadth first. Need not be used.
   */
  const struct HcNode *nodes;
  /*
   Lower corner of the octree's cube.
   */
  double cube_origin[3];
  /*
   Half the edge of that cube.
   */
  double cube_half_edge;
  /*
   Deepest level allowed for the octree.
   */
  uint32_t octree_levels;
  /*
   A node with no more surfaces than this is not divided.
   */
  uint32_t octree_min_items;
  /*
   1: a surface is in the cell of its middle, of an edge no smaller than the surface; 0: in a cell holding it all.
   */
  uint32_t octree_loose;
  /*
   Zero.
   */
  uint32_t reserved;
} HcScene;

/*
 Settings of hemicubes, from `load` on.

 A hemicube has an atlas of 3 N² pixels, N wide: N rows of the top face, then N/2 rows of each side, +x, −x, +y, −y
 (of the emitter's axes: tangent, bitangent, normal). A direction (x, y, z) in those axes meets a face at (u/w, v/w):

 ```text
 top  u =  x  v = y  w =  z      pixel column from u/w in -1…1, row from v/w in -1…1
 +x   u =  y  v = z  w =  x      pixel column from u/w in -1…1, row from v/w in  0…1
 -x   u = -y  v = z  w = -x
 +y   u = -x  v = z  w =  y
 -y   u =  x  v = z  w = -y
 ```
 */
typedef struct HcSettings {
  /*
   Bytes of this struct.
   */
  uint32_t struct_size;
  /*
   N: a multiple of 16 from 16 to 1024.
   */
  uint32_t resolution;
  /*
   1: skip invisible surfaces; 0: rasterise every surface. The rows are the same.
   */
  uint32_t culling;
  /*
   1: rows carry covered weights and tiny patches.
   */
  uint32_t covered;
  /*
   Weight of each pixel of the atlas, 3 N² of them, with the sum `HC_WHOLE`.
   */
  const uint32_t *weights;
} HcSettings;

/*
 Position and axes of a hemicube. Stands in arrays, so it does not grow.
 */
typedef struct HcHemicube {
  /*
   Its own patch, never seen; `HC_NO_PATCH` for a free point.
   */
  uint32_t emitter;
  /*
   Zero.
   */
  uint32_t reserved;
  /*
   The centre.
   */
  double origin[3];
  /*
   Tangent, bitangent and normal, orthonormal and right-handed.
   */
  double axes[9];
} HcHemicube;

/*
 Counters of a call. Zeroed by the host; a 0 counts for none.
 */
typedef struct HcCounters {
  /*
   Hemicubes rendered.
   */
  uint64_t hemicubes;
  /*
   Nodes of the hierarchy tested.
   */
  uint64_t nodes_tested;
  /*
   Nodes found outside every face.
   */
  uint64_t nodes_outside;
  /*
   Nodes found hidden behind earlier surfaces.
   */
  uint64_t nodes_hidden;
  /*
   Triangles transformed into a hemicube's frame.
   */
  uint64_t triangles_transformed;
  /*
   Triangles rasterised, counted once a face.
   */
  uint64_t triangles_drawn;
  /*
   Hardware occlusion queries issued.
   */
  uint64_t queries;
  /*
   Bytes read back from a device.
   */
  uint64_t bytes_read_back;
  /*
   Zero.
   */
  uint64_t reserved[8];
} HcCounters;

/*
 Times of a call, in nanoseconds. Zeroed by the host; a 0 was not measured.
 */
typedef struct HcStageTimes {
  /*
   Choosing the surfaces to draw.
   */
  uint64_t cull;
  /*
   Drawing depths and ids.
   */
  uint64_t render;
  /*
   Drawing visible patches alone, for covered weights.
   */
  uint64_t cover;
  /*
   Adding up weights and picking nonzero entries.
   */
  uint64_t reduce;
  /*
   Bringing rows back.
   */
  uint64_t read_back;
  /*
   Zero.
   */
  uint64_t reserved[3];
} HcStageTimes;

/*
 Hemicubes in, rows out. All arrays are the host's, large enough for any row.

 Row k is the entries from `row_end[k - 1]` (0 for the first) to `row_end[k]`. A row depends on the scene, the
 settings and its own hemicube only: not on its place in a call, nor on earlier calls.
 */
typedef struct HcRows {
  /*
   Bytes of this struct.
   */
  uint32_t struct_size;
  /*
   Number of hemicubes.
   */
  uint32_t row_count;
  /*
   Room for entries: the number of patches, for each row.
   */
  uint64_t capacity;
  /*
   In: `row_count` hemicubes.
   */
  const struct HcHemicube *hemicubes;
  /*
   Out: one past the last entry of each row.
   */
  uint64_t *row_end;
  /*
   Out: the patch of each entry, strictly ascending within a row.
   */
  uint32_t *patches;
  /*
   Out: weight of the patch's visible pixels.
   */
  uint32_t *visible;
  /*
   Out: weight of the pixels covered by the patch alone, by the same rasteriser, so at least `visible`; both 0 for
   a sub-pixel patch. NULL unless covered weights were asked for.
   */
  uint32_t *covered;
  /*
   Out: escaped weight of each row.
   */
  uint32_t *escaped;
  /*
   Out: weight blocked by backs of one-sided surfaces, for each row.
   */
  uint32_t *blocked;
  /*
   Out: counters.
   */
  struct HcCounters counters;
  /*
   Out: times.
   */
  struct HcStageTimes stage_times;
} HcRows;

/*
 The view through a mirror or a pane, in the pixels of a hemicube that show it.
 */
typedef struct HcPass {
  /*
   Bytes of this struct.
   */
  uint32_t struct_size;
  /*
   Zero.
   */
  uint32_t reserved;
  /*
   The eye: behind a mirror the hemicube's, reflected.
   */
  double origin[3];
  /*
   Tangent, bitangent and normal, orthonormal; left-handed behind a mirror. Fronts stay fronts.
   */
  double axes[9];
  /*
   Normal of the portal's plane, of unit length.
   */
  double normal[3];
  /*
   Only points p with normal · p > `offset` are seen.
   */
  double offset;
  /*
   Number of words of `open`: 3 N² / 32.
   */
  uint64_t word_count;
  /*
   A bit for each pixel of the atlas, from the lowest of the first word on: 1 where it is open.
   */
  const uint32_t *open;
} HcPass;

/*
 Rays from one patch, and what they meet.

 A ray meets the first surface strictly between its ends, but none of the emitter's, and none without a corner more
 than `plane_tolerance` above the emitter's plane. What rounding might decide is `HC_DOUBTFUL`, and the host's to
 decide: an edge, an end, the plane, and which of two surfaces is first within 40,000 × `plane_tolerance` of each
 other. Within 100 × `plane_tolerance` of an edge, across the ray, no answer is certain: the host may take pieces of
 a wall for one polygon. A certain answer that is wrong makes a matrix wrong in silence.
 */
typedef struct HcRays {
  /*
   Bytes of this struct.
   */
  uint32_t struct_size;
  /*
   The patch that they start from.
   */
  uint32_t emitter;
  /*
   Normal of its plane, of unit length, on the side that the rays leave to.
   */
  double normal[3];
  /*
   The plane: normal · p = `offset`.
   */
  double offset;
  /*
   Number of rays.
   */
  uint64_t ray_count;
  /*
   In: six numbers a ray: its start and its end.
   */
  const double *ends;
  /*
   Out: the patch that each meets, `HC_BLOCKED` for a back, `HC_ESCAPED` for nothing, or `HC_DOUBTFUL`.
   */
  uint32_t *met;
} HcRays;

/*
 The table: the one export of a plugin, under the name `hemicube_backend`.

 [any-thread]: may be called at any time from any thread, also at once. [session-thread]: never two calls at once
 with one session, but the next may come from another thread; different sessions may be called at once. State bound
 to a thread, such as a GL context, is therefore made current when a call begins and released when it ends. The host
 holds no lock during a call. Nothing may unwind out of a function. The image is never unloaded.

 The first version ended at `close`, and such a table stays valid: a host takes entries beyond `struct_size` for
 NULL.
 */
typedef struct HcBackend {
  /*
   `HC_ABI_VERSION`. Read before anything else.
   */
  uint32_t abi_version;
  /*
   `sizeof(HcBackend)` in the plugin.
   */
  uint32_t struct_size;
  /*
   Name, `[a-z0-9-]{1,32}`. The file is called `hemicube_backend_NAME`, with `_` for `-`, between the platform's
   prefix and suffix of shared libraries.
   */
  const char *name;
  /*
   Version of the arithmetic: matrices of different versions are not mixed. UTF-8, not empty.
   */
  const char *version;
  /*
   Writes up to `capacity` devices, best first, and how many there are to `*count`. None is no error. [any-thread]
   */
  HcStatus (*devices)(struct HcDevice *out, uint32_t capacity, uint32_t *count, struct HcError *error);
  /*
   Opens a session on a device by its place in the list. `options` is `key=value,key=value`, UTF-8, or NULL; an
   unknown key is an error. [any-thread]
   */
  HcStatus (*open)(const struct HcHost *host,
                   uint32_t device,
                   const char *options,
                   HcSession **session,
                   struct HcError *error);
  /*
   Describes the session, from `open` on, and again from `load` on. NULL: it is described by `devices` and
   `version`. [session-thread]
   */
  HcStatus (*info)(HcSession *session, struct HcSessionInfo *info, struct HcError *error);
  /*
   Takes a scene and its settings, in place of the one before. [session-thread]
   */
  HcStatus (*load)(HcSession *session,
                   const struct HcScene *scene,
                   const struct HcSettings *settings,
                   struct HcError *error);
  /*
   Renders hemicubes and reduces them to rows. [session-thread]
   */
  HcStatus (*rows)(HcSession *session, struct HcRows *rows, struct HcError *error);
  /*
   Writes the visible patch of each of the 3 N² pixels of a hemicube, or `HC_BLOCKED` or `HC_ESCAPED`. NULL without
   `HC_CAN_ITEMS`. [session-thread]
   */
  HcStatus (*items)(HcSession *session,
                    const struct HcHemicube *hemicube,
                    uint32_t *items,
                    struct HcError *error);
  /*
   Ends a session, whatever state it is in. [session-thread]
   */
  void (*close)(HcSession *session);
  /*
   Writes what each open pixel of a pass shows, as `items` does; closed pixels may hold anything. NULL, or not
   there, without `HC_CAN_PASSES`: the host then draws passes itself. [session-thread]
   */
  HcStatus (*pass)(HcSession *session, const struct HcPass *pass, uint32_t *items, struct HcError *error);
  /*
   Casts rays. NULL, or not there, without `HC_CAN_RAYS`: the host then casts all rays itself. [session-thread]
   */
  HcStatus (*rays)(HcSession *session, struct HcRays *rays, struct HcError *error);
} HcBackend;

#endif  /* HEMICUBE_BACKEND_H */

#ifdef __cplusplus
extern "C" {
#endif

/* Defined by the plugin, once in its image. */
extern HC_EXPORT const HcBackend hemicube_backend;

#ifdef __cplusplus
}
#endif
