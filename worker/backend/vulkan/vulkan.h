/* The Vulkan backend: private declarations that its files share.
 *
 * One file a pass, with the same names as in every backend's folder: validity.c, direct.c, gather.c, probes.c,
 * occlusion.c, directional.c, path.c, radiance.c, guided.c, land.c, weighed.c, patches.c, bidirectional.c (with
 * bidirectional_stages.c). The others: vulkan.c (the list of passes, life of the backend), resources.c (upload of its
 * resources), core.c (functions for all files), intersect.c (closest hits), kernels.c (creation of kernels, also in
 * advance), surfaces.c (scene data for paths and chains), regression.c (denoising), chunks.c (running a pass over tile
 * runs in chunks), hemisphere.c (common part of passes that sample the hemisphere over points), answers.c (short
 * answers of points), points.c (surface points on the device), visibility.c (visibility of pairs of patches),
 * kept_rows.c and held.c (kept rows, and light held on the device), groups.c (the light of groups), lights.c,
 * materials.c and techniques.c (the scene on the device), bvh.c, bvh_device.c, bvh_top.c, acceleration.c and tracer.c
 * (ray tracing), layout.h (data shared by C and shaders). gpu/ is Vulkan compute, independent of light transport.
 *
 * The device stores the scene (BVH, hit records, materials, lights: struct kiln_gpu_scene names them), the radiosity of
 * all points, and this rank's own points in blocks (points.h). A pass divides its batch into chunks that take about one
 * slice of time (chunks.h); two to three chunks are in flight at once, so that the device does not wait while the host
 * takes answers over.
 *
 * Nothing in this folder is collective. Unless said otherwise functions return KILN_OK, KILN_NO_DEVICE when the device
 * is lost or its memory short, or KILN_SYSTEM when the host's is. When a device is lost, so are all buffers: see
 * vulkan_recover. */
#ifndef KILN_WORKER_BACKEND_VULKAN_VULKAN_H
#define KILN_WORKER_BACKEND_VULKAN_VULKAN_H

#include "worker/backend/api.h"
#include "worker/backend/extended.h"
#include "worker/backend/vulkan/gpu/gpu.h"
#include "worker/backend/vulkan/layout.h"
#include "worker/backend/vulkan/lights.h"
#include "worker/backend/vulkan/materials.h"
#include "worker/backend/vulkan/points.h"
#include "worker/backend/vulkan/techniques.h"
#include "worker/backend/vulkan/tracer.h"
#include "worker/light/lights.h"
#include "worker/pass/path.h"
#include "worker/scene/voxels.h"
#include "worker/store/store.h"

#include "shaders/modules.h"
#include "shaders/shared/push.h"
#include "shaders/shared/rows.h"
#include "shaders/shared/slices.h"

/* A shader and its variants; those that do not exist are NULL. Ray tracing kernels have a pipeline variant. */
struct vulkan_shader {
    const char *name;
    const struct gpu_code *compute, *pipeline;             /* with doubles, where the kernel uses `real` */
    const struct gpu_code *compute_float, *pipeline_float; /* without; NULL: it does not use `real` */
    const struct vulkan_shader *gloss; /* variant for simulated gloss of materials; NULL: the shader itself */
};
#define VULKAN_CODE(name) &kiln_code_##name

/* Numbers of the specialisation constants that all kernels share (shaders/kernel.glsl); VULKAN_OWN is specific to each
 * kernel. */
enum vulkan_constant {
    VULKAN_TRAVERSAL,
    VULKAN_HAS_ALPHA,
    VULKAN_HAS_SMOOTH,
    VULKAN_LIGHT_KINDS,
    VULKAN_DRAW_AGAIN,
    VULKAN_HAS_DIVIDED,
    VULKAN_OWN,
    VULKAN_HAS_COINCIDENT,
    VULKAN_HAS_OCTREE,
    VULKAN_HAS_VARIED,
    VULKAN_HAS_GLOSSY,
    VULKAN_HAS_BRUSHED,
    VULKAN_HAS_TRAPPED,
    VULKAN_LOBE_KINDS,
    VULKAN_TEXTURED,
    VULKAN_CONSTANTS
};
_Static_assert((int)VULKAN_CONSTANTS <= (int)KILN_MADE_CONSTANTS, "room for them");

struct vulkan_kernel {
    const struct vulkan_shader *shader;
    uint32_t draw_again, own;
    bool ran;
    struct vulkan_maker *maker; /* thread that is creating it (kernels.c); NULL: none */
    struct gpu_kernel *kernel;
};

/* Buffers of a chunk in flight. */
struct vulkan_slot {
    struct gpu_buffer scratch, answers, host;
    struct gpu_buffer guides, guides_host; /* data of the guided pass, or rows of kept rays */
    struct gpu_buffer groups, groups_host; /* answers of groups (groups.h), of the chunk of these tile runs: */
    size_t group_first, group_runs;
};

/* Rows of kept rays that stay on the device (kept_rows.h). */
struct vulkan_resident {
    const struct kiln_resident_rows *of;
    uint64_t key; /* identity of the rows */
    struct gpu_buffer words;
    uint8_t *there; /* whether the rows of each of this rank's tile runs are there */
};

/* Arrays of the bright patches on the device (bright.h). */
enum {
    VULKAN_BRIGHT_CLUSTERS,
    VULKAN_BRIGHT_CLUSTER_POWER,
    VULKAN_BRIGHT_MEMBERS,
    VULKAN_BRIGHT_CLUSTER_OF,
    VULKAN_BRIGHT_POWER,
    VULKAN_BRIGHT_PATCHES,
    VULKAN_BRIGHT_ARRAYS
};

/* The spheres about probes on the device (spheres.h). */
enum {
    VULKAN_SPHERES_SPHERES,
    VULKAN_SPHERES_CLEAR,
    VULKAN_SPHERES_PATHS,
    VULKAN_SPHERES_SUMS,
    VULKAN_SPHERES_MOMENTS,
    VULKAN_SPHERES_ROOT,
    VULKAN_SPHERE_ARRAYS
};

/* The tree of links on the device (links.c). */
enum { VULKAN_LINK_NODES, VULKAN_LINK_LEAVES, VULKAN_LINK_LIGHT, VULKAN_LINK_PLACES, VULKAN_LINK_ARRAYS };
enum { VULKAN_LINK_GROUPS = 2 }; /* groups of tile runs whose links are found alternately: link_views.c */

/* Light that stays on the device (held.h). */
struct vulkan_held {
    uint32_t count; /* lights; 0: nothing is held */
    struct kiln_gpu_held layout;
    struct gpu_buffer root, points, lights, sums, errors, direct, direct_errors, mixes, parts, powers, bytes;
    struct gpu_buffer radiosity[2]; /* radiosity that is read, and that is written; alternately */
    struct gpu_buffer albedo[KILN_ROW_LIGHTS];
    uint64_t room;                      /* approximate bytes of these buffers */
    const struct kiln_surface *surface; /* surface of these points; NULL: none yet */
    struct vulkan_held_answers {        /* direct light of each term */
        uint64_t key;
        struct gpu_buffer buffer;
        bool wanted; /* needed by the lights being uploaded */
    } * answers;
    size_t answer_count, answer_room;
};

/* Visibility between pairs of patches (visibility.h). */
struct vulkan_visibility {
    struct kiln_voxel_arrays grid; /* the uploaded grid; words NULL: none */
    struct gpu_buffer words, reals;
    struct gpu_buffer root; /* struct kiln_gpu_sight */
    /* cache whose pairs are kept, NULL: none; and the state for which its buffers were made */
    const struct kiln_visibility_cache *of;
    const struct kiln_surface *surface;
    uint64_t moved, first, count, groups;
    uint64_t step;              /* last step for which outdated results were dropped */
    uint64_t *places;           /* mask of computed points in each of this rank's tile runs */
    struct gpu_buffer *buffers; /* tile runs' words */
    size_t buffer_count, buffer_room;
    struct gpu_buffer runs, changes; /* changes: masks of the step's and of unchanged columns, flags of resets */
    struct gpu_kernel *open, *close, *store;
};

#define VULKAN_USUAL_SCRATCH (512ull << 20) /* bytes */

enum { VULKAN_REGRESSION_SWEEPS = 5, VULKAN_REGRESSION_ARRAYS = 8 };

/* Kinds of work whose speed is measured separately: each pass (KILN_PASS_INDEX_gather and so on), and these. */
enum vulkan_pace {
    VULKAN_PACE_CEILING = KILN_PASS_COUNT,
    VULKAN_PACE_INTERSECT,
    VULKAN_PACE_REPLAY,
    VULKAN_PACE_LINK_RAYS,
    VULKAN_PACE_LIGHT_PATHS, /* kernels of the bidirectional pass */
    VULKAN_PACE_EYE_PATHS,
    VULKAN_PACE_LIGHT_DIFFUSE,
    VULKAN_PACE_EYE_DIFFUSE,
    VULKAN_PACE_EYE_ENDS,
    VULKAN_PACE_BURIED_ENDS,
    VULKAN_PACE_PATH_RAYS,
    VULKAN_PACE_SHADOW_RAYS,
    VULKAN_PACE_CAMERA_RAYS,
    VULKAN_PACE_PAIRS,
    VULKAN_PACE_NEAR,
    VULKAN_PACE_CONNECT,
    VULKAN_PACE_MERGE,
    VULKAN_PACE_SPLAT,
    VULKAN_PACE_PHOTONS,
    VULKAN_PACE_SPHERES,    /* light paths that cross spheres of probes */
    VULKAN_PACE_REGRESSION, /* first sweep of the regression; the other sweeps follow */
    VULKAN_PACES = VULKAN_PACE_REGRESSION + VULKAN_REGRESSION_SWEEPS
};

struct vulkan_backend {
    struct kiln_backend base;
    struct kiln_backend_params params;
    const struct kiln_surface *surface; /* surface that passes run over; NULL: not given yet */
    const uint64_t *radiosity;          /* NULL: not given yet */
    /* while `surface` is another rank's: that rank's tile runs are in use, and this rank's surface and points are
     * stored here */
    const struct kiln_surface *own;
    struct vulkan_points *own_points;
    /* NULL: the device was lost and could not be set up again; only info and destroy may follow */
    struct gpu *gpu;
    /* sets up the device again with the scene, the surface, its radiosity and probes (called by vulkan_recover) */
    int (*make_anew)(struct vulkan_backend *b, struct kiln_error *error);
    struct gpu_faults faults;
    uint32_t recoveries;                  /* so far */
    double busy_before;                   /* busy time of the devices before recoveries, s */
    uint64_t kernels_found, kernels_made; /* kernels of the devices before recoveries */
    uint64_t scratch_most; /* maximum bytes of a slot's partial sums: the larger of a sixteenth of the device's memory
                            * and VULKAN_USUAL_SCRATCH; less after memory was short */
    bool float64;
    uint32_t threads;     /* vulkan_light_threads */
    uint32_t all_threads; /* host threads for long computations there */
    /* the scene on the device */
    struct kiln_gpu_scene layout;
    struct gpu_buffer scene, records;
    struct vulkan_tracer tracer;
    struct vulkan_materials materials;
    bool all_materials;               /* they include all surfaces: see vulkan_surfaces */
    struct gpu_buffer path_triangles; /* struct kiln_gpu_path_triangle */
    struct vulkan_lights lights;
    /* if params.direct_lights are given: these lights, and a scene that has them instead of the lights */
    struct vulkan_lights direct_lights;
    struct kiln_gpu_lights direct_layout;
    struct gpu_buffer direct_scene;
    /* the surface */
    struct gpu_buffer store_arrays[KILN_STORE_ARRAYS], radiosity_buffer;
    struct vulkan_points *points;
    const struct kiln_radiance_probes *probes; /* NULL: gather rays have unlimited length */
    struct gpu_buffer probes_root, probe_positions, probe_data;
    /* the passes */
    uint32_t constants[VULKAN_CONSTANTS];
    size_t kernel_count, kernel_room;
    struct vulkan_kernel *kernels;
    struct kiln_aside making;                           /* background creation of kernels that were requested since */
    struct kiln_made_kernel slowest[KILN_MADE_KERNELS]; /* struct kiln_backend_info */
    struct gpu_buffer sobol;                            /* KILN_DIMENSIONS times sobol_count words */
    uint32_t sobol_count;
    struct gpu_buffer rays, hits; /* host memory: rays and hits of the last vulkan_intersect, with spare room */
    struct vulkan_slot slots[GPU_SLOTS];
    char *results; /* host memory: results converted from short ones (hemisphere.h) */
    size_t result_room;
    struct vulkan_techniques techniques;             /* data of the current pass, if it is land or weighed */
    struct gpu_buffer spheres[VULKAN_SPHERE_ARRAYS]; /* data of the current land pass, if its paths cross spheres */
    struct vulkan_resident *resident;
    size_t resident_count, resident_room;
    struct vulkan_held held;
    struct gpu_buffer regression[VULKAN_REGRESSION_ARRAYS]; /* regression.c */
    uint8_t *regression_host;                               /* host memory, of regression_room bytes */
    size_t regression_room;
    double once_seconds, once_processor;          /* struct kiln_backend_info */
    uint64_t returned;                            /* bytes of answers so far */
    struct gpu_buffer light_groups, group_lights; /* groups.h */
    struct gpu_buffer row_lights; /* radiosity that is not the backend's, for the current pass; else an outdated one */
    struct gpu_buffer direction_set;                 /* for the current or an earlier pass: shaders/directions.glsl */
    struct gpu_buffer bright[VULKAN_BRIGHT_ARRAYS];  /* for the current or an earlier pass: bright.h */
    struct gpu_buffer links[VULKAN_LINK_ARRAYS];     /* for the current or an earlier pass: links.c */
    uint64_t link_keys[VULKAN_LINK_ARRAYS];          /* hashes of the content of `links` */
    struct gpu_buffer link_rays[VULKAN_LINK_GROUPS]; /* buffers of groups: link_views.c, as are the next */
    struct gpu_buffer link_answers[VULKAN_LINK_GROUPS];
    struct gpu_buffer patches, node_facings, node_shapes; /* data of the current patches pass; else of an earlier one */
    struct vulkan_visibility visibility;
    struct gpu_pacer pacers[VULKAN_PACES];
    struct both_run *both; /* state of the bidirectional or land pass, kept for its next call; or NULL */
    double light_vertices; /* estimated stored vertices of a light path, which determines the room for them */
    double build_seconds;
    char device_text[128]; /* device and ray tracer; remains valid when the device is gone */
};

/* Measures the time of one-time work (creation, upload) for which the caller waits: see struct kiln_backend_info. */
struct vulkan_once {
    double seconds;
    clock_t processor;
};
struct vulkan_once vulkan_once_begin(void);
void vulkan_once_end(struct vulkan_backend *b, struct vulkan_once begin);

/* Returns the kernel of a shader; created on first use, destroyed with the backend. `own`: value of the kernel's own
 * specialisation constant. */
int vulkan_kernel_of(struct vulkan_backend *b, const struct vulkan_shader *shader, bool draw_again, uint32_t own,
                     struct gpu_kernel **kernel, struct kiln_error *error);

/* Destroys the kernels, since the state that they were made from has changed. */
void vulkan_forget_kernels(struct vulkan_backend *b);
/* Enlarges a slot's buffer to at least `size` bytes (guarded: exactly); its content is lost. It must not be in use. */
int vulkan_grow_buffer(struct vulkan_backend *b, struct gpu_buffer *buffer, size_t size, enum gpu_memory memory,
                       const char *what, struct kiln_error *error);
/* Uploads b->layout after a change. */
int vulkan_upload_root(struct vulkan_backend *b, struct kiln_error *error);
/* Uploads scene data that only paths and chains read: colours, gloss and normals of all surfaces. In scenes with
 * simulated gloss they are there from the start. */
int vulkan_surfaces(struct vulkan_backend *b, struct kiln_error *error);
/* Rays that lie on the device: `count` origins, directions (struct kiln_vec3) and room for hits (struct kiln_gpu_hit).
 * One dispatch. */
int vulkan_intersect_on_device(struct vulkan_backend *b, uint64_t origins, uint64_t directions, uint64_t hits,
                               uint32_t count, double *seconds, struct kiln_error *error);

/* Whether trying again may help after a failure: the device was lost or short of memory, and not too often. */
bool vulkan_can_recover(const struct vulkan_backend *b);
/* Sets up the device again with its data (but for buffers of passes); if memory was short, passes get half as much from
 * now on. Pointers to kernels and addresses are no longer valid. KILN_NO_DEVICE when that fails too. */
int vulkan_recover(struct vulkan_backend *b, struct kiln_error *error);

/* Function that runs the rest of a batch, and removes the items taken from *left. *refused: the taker failed, so that
 * trying again is useless. */
typedef int (*vulkan_run_left)(struct vulkan_backend *b, const void *parameters, struct kiln_batch *left,
                               uint64_t *rays, bool *refused, struct kiln_error *error);
/* Runs a batch to its end, and sets up the device again as long as that may help. For passes that are not over tile
 * runs; chunks.h does this for those that are. */
int vulkan_run_to_end(struct vulkan_backend *b, vulkan_run_left run_left, const void *parameters,
                      const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);

/* Releases the data that the bidirectional or the land pass keeps from one call to the next. */
void vulkan_bidirectional_release(struct vulkan_backend *b);

/* Answers of pixels from their sums on the device; adds up their rays. KILN_NO_DEVICE: the device has ended a loop
 * early. */
int vulkan_read_path_sums(const struct vulkan_backend *b, const struct kiln_gpu_path_sums *sums, size_t count,
                          struct kiln_path_result *results, uint64_t *rays, struct kiln_error *error);

/* Uploads Sobol' points 0 .. count-1 of all dimensions: dimension d from word d * b->sobol_count on. */
int vulkan_sobol(struct vulkan_backend *b, uint32_t count, struct kiln_error *error);
/* The address of Sobol' point `first_sample` in dimension 0. */
static inline uint64_t vulkan_sobol_from(const struct vulkan_backend *b, uint32_t first_sample)
{
    return b->sobol.address + first_sample * sizeof(uint32_t);
}

/* Distributes the samples of a point over threads of the device. */
static inline struct kiln_slices vulkan_slices_of(const struct vulkan_backend *b, uint32_t samples)
{
    return kiln_slices_of(samples, gpu_about(b->gpu)->software);
}

/* Creates buffers that passes over the surface will need, as far as memory allows (chunks.c). */
void vulkan_passes_ahead(struct vulkan_backend *b);

/* A kernel to create: arguments of vulkan_kernel_of. */
struct vulkan_wish {
    const struct vulkan_shader *shader;
    bool draw_again;
    uint32_t own;
    bool (*wanted)(const struct vulkan_backend *b); /* NULL: always */
};

/* Whether threads create kernels in advance. Not on software devices, which compile kernels when they first run, nor
 * for ray-tracing kernels, which several threads cannot create at once. */
bool vulkan_has_makers(const struct vulkan_backend *b);
/* Whether the kernel's constants depend on the surface. */
bool vulkan_hangs_on_surface(const struct vulkan_backend *b, const struct vulkan_wish *wish);
/* Begins to create missing kernels, all at once; vulkan_kernel_of waits for each. Ignores `wanted`. The list ends at
 * the first entry without a shader. */
void vulkan_kernels_at_once(struct vulkan_backend *b, const struct vulkan_wish *wishes, size_t count);

/* Implementation of a pass in this backend: vulkan_pass_validity in validity.c, vulkan_pass_direct in direct.c and so
 * on. */
enum { VULKAN_WISHES = 6 };
struct vulkan_pass {
    /* Runs the pass over a batch, calls its taker and adds its rays to *rays. All items have batch->samples samples.
     * When the device is lost or short of memory it is set up again (vulkan_recover), and the pass continues with the
     * items not yet taken. */
    int (*run)(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error);
    /* Kernels to create in advance if the pass is known to come, up to the first without a shader; others are created
     * when it first runs. */
    struct vulkan_wish ahead[VULKAN_WISHES];
    /* Begins to create kernels that depend on the pass's parameters (kiln_backend_expect); NULL: `ahead` lists all. */
    void (*expect)(struct vulkan_backend *b, const void *parameters);
    /* Releases data kept on the device from one call to the next; NULL: none. */
    void (*release)(struct vulkan_backend *b);
    /* whether the pass supports these parameters (kiln_backend_takes); NULL: any */
    bool (*takes)(const struct vulkan_backend *b, const void *parameters);
};
#define VULKAN_DECLARE(name) extern const struct vulkan_pass vulkan_pass_##name;
KILN_PASS_LIST_OF_ALL(VULKAN_DECLARE)
#undef VULKAN_DECLARE

/* kiln_backend_intersect (intersect.c). */
int vulkan_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins, const struct kiln_vec3 *directions,
                     size_t count, const struct kiln_ray_hints *hints, struct kiln_hit *hits, struct kiln_error *error);
/* kiln_backend_ceiling (gather.c, whose rays it traces). */
int vulkan_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                   struct kiln_error *error);

#endif
