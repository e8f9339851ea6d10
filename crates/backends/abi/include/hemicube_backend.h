/* The ABI of hemicube backends that are loaded at run time.
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
 Weight of a whole hemicube: a form factor is a weight divided by this. The weights of the visible patches of a
 hemicube, what escaped and what was blocked sum to exactly this.
 */
#define HC_WHOLE 2147483648

/*
 Where a patch number may be missing: the emitter of a free point, the back of a one-sided surface.
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
 Parent of an octree's root.
 */
#define HC_NO_NODE 4294967295

/*
 Done.
 */
#define HC_OK 0

/*
 A request that the contract does not allow. The session stays usable.
 */
#define HC_ERROR_INVALID_ARGUMENT 1

/*
 A legal request that this backend cannot serve. The session stays usable.
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
 A defect of the backend, as is every number that is not in this list. Only `close` may follow.
 */
#define HC_ERROR_INTERNAL 5

/*
 A panic, or an exception, that was caught at the boundary. Only `close` may follow.
 */
#define HC_ERROR_PANIC 6

/*
 Fills in covered weights when asked.
 */
#define HC_CAN_COVERED 1

/*
 Reports patches that cover no pixel centre but are nearest at their centroid, when covered weights are asked for.
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
 A device of none of the kinds below.
 */
#define HC_DEVICE_OTHER 0

/*
 A processor, or a graphics driver that runs on one. `--backend auto` prefers the built-in backend to it.
 */
#define HC_DEVICE_SOFTWARE 1

/*
 A GPU that shares the processor's memory.
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
 Something that a user should know of.
 */
#define HC_LOG_WARN 2

/*
 Something that a user may want to know.
 */
#define HC_LOG_INFO 3

/*
 For who looks for a defect.
 */
#define HC_LOG_DEBUG 4

/*
 `HC_OK` or an `HC_ERROR_…`. An integer, not an enum: any number may come from foreign code.
 */
typedef int32_t HcStatus;

/*
 A device that sessions can be opened on. Stands in arrays, so it does not grow.
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
   Largest resolution that it takes: a multiple of 16 from 16 to 1024.
   */
  uint32_t max_resolution;
  /*
   How many hemicubes a call it likes best; 0 is taken as 1.
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
 What the host offers. The struct is valid until `open` returns; `context` and `log` as long as the process.
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
 What a session is, when that says more than the device's entry: filled by `info`.
 */
typedef struct HcSessionInfo {
  /*
   Bytes of this struct.
   */
  uint32_t struct_size;
  /*
   As in `HcDevice`, of this session.
   */
  uint32_t preferred_rows;
  /*
   As in `HcDevice`, of this session.
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
   What was chosen for the loaded scene and why, a line each. May be empty.
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
   Smallest box over the node's own surfaces; `own_min` above `own_max` where there are none.
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
   How many children there are; 0 for a leaf.
   */
  uint32_t child_count;
  /*
   The node whose child this is; `HC_NO_NODE` for the root, which is the first node.
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
   How many patches there are: numbers run from 0 to one below.
   */
  uint32_t patch_count;
  /*
   Not 0: another call of `load` with this number brings the same scene, bit for bit, so that sessions can share
   what is made of it. 0: nothing is known.
   */
  uint64_t identity;
  /*
   A corner nearer than this to the emitter's plane counts as lying in it.
   */
  double plane_tolerance;
  /*
   How many surfaces there are.
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
   Patch on the back of each surface; `HC_NO_PATCH` for a one-sided one, whose back blocks.
   */
  const uint32_t *back;
  /*
   How many nodes the octree has.
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
   Deepest level that the octree may have.
   */
  uint32_t octree_levels;
  /*
   A node with no more surfaces than this is not divided.
   */
  uint32_t octree_min_items;
  /*
   1: a surface is in the cell that its middle is in and that it is no larger than; 0: in one that holds it all.
   */
  uint32_t octree_loose;
  /*
   Zero.
   */
  uint32_t reserved;
} HcScene;

/*
 How hemicubes are rendered, from `load` on.

 A hemicube has an atlas of 3 N² pixels, N wide: N rows of the top face, then N/2 rows of each side, +x, −x, +y, −y (of
 the emitter's axes: tangent, bitangent, normal). A direction (x, y, z) in those axes meets a face at (u/w, v/w):

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
   1: skip what cannot be seen; 0: rasterise every surface. The rows are the same.
   */
  uint32_t culling;
  /*
   1: rows carry covered weights and tiny patches.
   */
  uint32_t covered;
  /*
   Weight of each pixel of the atlas, 3 N² of them, which sum to `HC_WHOLE`.
   */
  const uint32_t *weights;
} HcSettings;

/*
 Where a hemicube stands and how it is turned. Stands in arrays, so it does not grow.
 */
typedef struct HcHemicube {
  /*
   The patch it belongs to, whose surface is not seen; `HC_NO_PATCH` for a free point.
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
 What was done for the rows of a call. Zeroed by the host; what is left 0 counts as none.
 */
typedef struct HcCounters {
  /*
   Hemicubes rendered.
   */
  uint64_t hemicubes;
  /*
   Nodes of the hierarchy that were tested.
   */
  uint64_t nodes_tested;
  /*
   Nodes found outside every face.
   */
  uint64_t nodes_outside;
  /*
   Nodes found hidden behind what was drawn before.
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
 Where the time of a call went, in nanoseconds. Zeroed by the host; what is left 0 was not measured.
 */
typedef struct HcStageTimes {
  /*
   Finding what can be seen.
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
   Adding up weights and picking the entries that are not zero.
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
 Hemicubes in, rows out. All arrays are the host's, and are large enough for any row.

 Row k is the entries from `row_end[k - 1]` (0 for the first) to `row_end[k]`. A row depends on the scene, the settings
 and its own hemicube only: not on its place in a call, nor on what was rendered before.
 */
typedef struct HcRows {
  /*
   Bytes of this struct.
   */
  uint32_t struct_size;
  /*
   How many hemicubes there are.
   */
  uint32_t row_count;
  /*
   How many entries there is room for: as many a row as the scene has patches.
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
   Out: weight of the pixels that show the patch.
   */
  uint32_t *visible;
  /*
   Out: weight of the pixels that the patch would cover alone, by the same rasteriser, so at least `visible`; both 0
   for a tiny patch. NULL unless covered weights were asked for.
   */
  uint32_t *covered;
  /*
   Out: weight that hit nothing, for each row.
   */
  uint32_t *escaped;
  /*
   Out: weight that hit the back of a one-sided surface, for each row.
   */
  uint32_t *blocked;
  /*
   Out: what was done.
   */
  struct HcCounters counters;
  /*
   Out: where the time went.
   */
  struct HcStageTimes stage_times;
} HcRows;

/*
 The table: the one thing that a plugin exports, under the name `hemicube_backend`.

 [any-thread]: may be called at any time from any thread, also at once. [session-thread]: never two calls at once with
 one session, but the next may come from another thread; different sessions may be called at once. So what is bound to
 a thread, such as a GL context, is made current when a call begins and released when it ends. The host holds no lock
 during a call. Nothing may unwind out of a function. The image is never unloaded.
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
   Name, `[a-z0-9-]{1,32}`. The file is called `hemicube_backend_NAME`, with `_` for `-`, and what the platform puts
   before and after the name of a shared library.
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
   Opens a session on the device with that place in the list. `options` is `key=value,key=value`, UTF-8, or NULL; a
   key that is not known is an error. [any-thread]
   */
  HcStatus (*open)(const struct HcHost *host,
                   uint32_t device,
                   const char *options,
                   HcSession **session,
                   struct HcError *error);
  /*
   Says what the session is, from `open` on, and again from `load` on. NULL: what `devices` and `version` say.
   [session-thread]
   */
  HcStatus (*info)(HcSession *session, struct HcSessionInfo *info, struct HcError *error);
  /*
   Takes a scene, and how to render it, in place of what was loaded before. [session-thread]
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
   The patch that each of the 3 N² pixels of a hemicube shows, or `HC_BLOCKED` or `HC_ESCAPED`. NULL where
   `HC_CAN_ITEMS` is missing. [session-thread]
   */
  HcStatus (*items)(HcSession *session,
                    const struct HcHemicube *hemicube,
                    uint32_t *items,
                    struct HcError *error);
  /*
   Ends a session, whatever state it is in. [session-thread]
   */
  void (*close)(HcSession *session);
} HcBackend;

#endif  /* HEMICUBE_BACKEND_H */

#ifdef __cplusplus
extern "C" {
#endif

/* What a plugin defines, in the one image that it is. */
extern HC_EXPORT const HcBackend hemicube_backend;

#ifdef __cplusplus
}
#endif
