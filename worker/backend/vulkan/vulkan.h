/* The Vulkan backend: private declarations that its files share.
 *
 * One file a pass, with the same names as in every backend's folder: validity.c, direct.c, gather.c, probes.c,
 * occlusion.c, directional.c, path.c, radiance.c, guided.c, land.c, weighed.c, patches.c, bidirectional.c (with
 * bidirectional_stages.c). The others: vulkan.c (the list of passes, life of the backend), resources.c (what it is
 * given), core.c (what all files use), intersect.c (closest hits), kernels.c (made, and made ahead), surfaces.c (of the
 * scene, what paths and chains ask for), regression.c (denoising), chunks.c (running a pass over tile runs in chunks),
 * hemisphere.c (what passes that sample the hemisphere over points have in common), answers.c (what a device hands over
 * of points), points.c (surface points on the device), visibility.c (what pairs of patches see), kept_rows.c and held.c
 * (kept rows, and light that stays with them), groups.c (the light of groups), lights.c, materials.c and techniques.c
 * (the scene on the device), bvh.c, bvh_device.c, bvh_top.c, acceleration.c and tracer.c (what finds hits), layout.h
 * (what C and the shaders share). gpu/ is Vulkan for compute and knows no light.
 *
 * On the device lie the scene (BVH, hit records, materials, lights: struct kiln_gpu_scene names them), the radiosity of
 * all points, and this rank's own points in blocks (points.h). A pass cuts its batch into chunks that take about one
 * slice of time (chunks.h); two to three chunks are under way at once, so that the device does not wait while answers
 * are taken over.
 *
 * Nothing in this folder is collective. Unless said otherwise functions return KILN_OK, KILN_NO_DEVICE when the device
 * is lost or its memory short, or KILN_SYSTEM when the host's is. A device that is lost takes all buffers with it:
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
    const struct vulkan_shader *gloss; /* in its place where materials are taken with their gloss; NULL: itself */
};
#define VULKAN_CODE(name) &kiln_code_##name

/* The numbers of the specialisation constants that all kernels share (shaders/kernel.glsl); VULKAN_OWN is each
 * kernel's own. */
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
    VULKAN_HAS_HELD,
    VULKAN_CONSTANTS
};

struct vulkan_kernel {
    const struct vulkan_shader *shader;
    uint32_t draw_again, own;
    bool ran;
    struct vulkan_maker *maker; /* the thread that makes it (kernels.c); NULL: none does */
    struct gpu_kernel *kernel;
};

/* Where a chunk under way keeps what it needs. */
struct vulkan_slot {
    struct gpu_buffer scratch, answers, host;
    struct gpu_buffer guides, guides_host; /* of the guided pass, or rows of kept rays */
    struct gpu_buffer groups, groups_host; /* answers of groups (groups.h), of the chunk of these tile runs: */
    size_t group_first, group_runs;
};

/* Rows of kept rays that stay on the device (kept_rows.h). */
struct vulkan_resident {
    const struct kiln_resident_rows *of;
    uint64_t key; /* which rows these are */
    struct gpu_buffer words;
    uint8_t *there; /* of each own tile run */
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
enum { VULKAN_LINK_GROUPS = 2 }; /* of tile runs whose links are found in turn: link_views.c */

/* Light that stays on the device (held.h). */
struct vulkan_held {
    uint32_t count; /* lights; 0: nothing is held */
    struct kiln_gpu_held layout;
    struct gpu_buffer root, points, lights, sums, errors, direct, direct_errors, mixes, parts, powers, bytes;
    struct gpu_buffer radiosity[2]; /* that is gathered from, and made; in turn */
    struct gpu_buffer albedo[KILN_ROW_LIGHTS];
    uint64_t room;                      /* bytes of these, about */
    const struct kiln_surface *surface; /* whose points these are; NULL: there are none yet */
    struct vulkan_held_answers {        /* direct light of parts */
        uint64_t key;
        struct gpu_buffer buffer;
        bool wanted; /* by the lights that are brought */
    } * answers;
    size_t answer_count, answer_room;
};

/* Visibility between pairs of patches (visibility.h). */
struct vulkan_visibility {
    struct kiln_voxel_arrays grid; /* that is there; words NULL: none */
    struct gpu_buffer words, reals;
    struct gpu_buffer root; /* struct kiln_gpu_sight */
    /* whose pairs are kept, NULL: none; and what they were made for */
    const struct kiln_visibility_cache *of;
    const struct kiln_surface *surface;
    uint64_t moved, first, count, groups;
    uint64_t step;              /* that was forgotten for last */
    uint64_t *places;           /* of each own tile run, the points that are computed */
    struct gpu_buffer *buffers; /* tile runs' words */
    size_t buffer_count, buffer_room;
    struct gpu_buffer runs, changes; /* changes: the columns of the step's nodes, which are the same, who forgets all */
    struct gpu_kernel *open, *close, *store;
};

#define VULKAN_USUAL_SCRATCH (512ull << 20) /* bytes */

enum { VULKAN_REGRESSION_SWEEPS = 5, VULKAN_REGRESSION_ARRAYS = 8 };

/* Kinds of work whose speed is learned, each on its own: each pass (KILN_PASS_INDEX_gather and so on), and these. */
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
    VULKAN_PACE_REGRESSION, /* of its first sweep; those of the others follow */
    VULKAN_PACES = VULKAN_PACE_REGRESSION + VULKAN_REGRESSION_SWEEPS
};

struct vulkan_backend {
    struct kiln_backend base;
    struct kiln_backend_params params;
    const struct kiln_surface *surface; /* that passes run over; NULL: not given yet */
    const uint64_t *radiosity;          /* NULL: not given yet */
    /* while that is of another rank: the tile runs of it, the own surface, and the points of that */
    const struct kiln_surface *own;
    struct vulkan_points *own_points;
    /* NULL: it was lost and could not be made anew; only info and destroy may follow */
    struct gpu *gpu;
    /* makes the device anew with the scene, the surface, its radiosity and probes (vulkan_recover asks for it) */
    int (*make_anew)(struct vulkan_backend *b, struct kiln_error *error);
    struct gpu_faults faults;
    uint32_t recoveries;                  /* so far */
    double busy_before;                   /* s, of the devices before them */
    uint64_t kernels_found, kernels_made; /* likewise */
    uint64_t scratch_most; /* bytes that a slot's partial sums may take: of a sixteenth of the device's memory or
                            * VULKAN_USUAL_SCRATCH the more; less after memory was short */
    bool float64;
    uint32_t threads;     /* vulkan_light_threads */
    uint32_t all_threads; /* of the host, for what takes its time there */
    /* the scene on the device */
    struct kiln_gpu_scene layout;
    struct gpu_buffer scene, records;
    struct vulkan_tracer tracer;
    struct vulkan_materials materials;
    bool all_materials;               /* they are those of all surfaces: see vulkan_surfaces */
    struct gpu_buffer path_triangles; /* struct kiln_gpu_path_triangle */
    struct vulkan_lights lights;
    /* where params.direct_lights are given: these, and the scene that has them in the place of the lights */
    struct vulkan_lights direct_lights;
    struct kiln_gpu_lights direct_layout;
    struct gpu_buffer direct_scene;
    /* the surface */
    struct gpu_buffer store_arrays[KILN_STORE_ARRAYS], radiosity_buffer;
    struct vulkan_points *points;
    const struct kiln_radiance_probes *probes; /* NULL: gather rays have no end */
    struct gpu_buffer probes_root, probe_positions, probe_data;
    /* the passes */
    uint32_t constants[VULKAN_CONSTANTS];
    size_t kernel_count, kernel_room;
    struct vulkan_kernel *kernels;
    struct kiln_aside making; /* by threads; of kernels that were asked for since */
    struct gpu_buffer sobol;  /* KILN_DIMENSIONS times sobol_count words */
    uint32_t sobol_count;
    struct gpu_buffer rays, hits; /* of the host: what vulkan_intersect was last asked, with room for more */
    struct vulkan_slot slots[GPU_SLOTS];
    char *results; /* of the host: where short results are made long (hemisphere.h) */
    size_t result_room;
    struct vulkan_techniques techniques;             /* of the pass under way, where it is land or weighed */
    struct gpu_buffer spheres[VULKAN_SPHERE_ARRAYS]; /* of the land pass under way, where paths cross them */
    struct vulkan_resident *resident;
    size_t resident_count, resident_room;
    struct vulkan_held held;
    struct gpu_buffer regression[VULKAN_REGRESSION_ARRAYS]; /* regression.c */
    uint8_t *regression_host;                               /* the same, of so many bytes */
    size_t regression_room;
    double once_seconds, once_processor;          /* struct kiln_backend_info */
    uint64_t returned;                            /* bytes of answers so far */
    struct gpu_buffer light_groups, group_lights; /* groups.h */
    struct gpu_buffer row_lights; /* radiosity that is not the backend's, of the pass under way; else of one before */
    struct gpu_buffer direction_set;                 /* likewise: shaders/directions.glsl */
    struct gpu_buffer bright[VULKAN_BRIGHT_ARRAYS];  /* likewise: bright.h */
    struct gpu_buffer links[VULKAN_LINK_ARRAYS];     /* likewise: links.c */
    uint64_t link_keys[VULKAN_LINK_ARRAYS];          /* hashes of what they hold */
    struct gpu_buffer link_rays[VULKAN_LINK_GROUPS]; /* of groups: link_views.c, as are the next */
    struct gpu_buffer link_answers[VULKAN_LINK_GROUPS];
    struct gpu_buffer patches, node_facings, node_shapes; /* of the patches pass under way; else of one before */
    struct vulkan_visibility visibility;
    struct gpu_pacer pacers[VULKAN_PACES];
    struct both_run *both; /* what the bidirectional or the land pass has made, for its next call; or NULL */
    double light_vertices; /* of a path of light that are kept, as far as is known: what there is room for */
    double build_seconds;
    char device_text[128]; /* the device and how it traces; stays when it is gone */
};

/* Around what is made or brought once, while the caller waits: struct kiln_backend_info says what. */
struct vulkan_once {
    double seconds;
    clock_t processor;
};
struct vulkan_once vulkan_once_begin(void);
void vulkan_once_end(struct vulkan_backend *b, struct vulkan_once begin);

/* The kernel of a shader; made when first asked for, destroyed with the backend. `own`: the kernel's own constant. */
int vulkan_kernel_of(struct vulkan_backend *b, const struct vulkan_shader *shader, bool draw_again, uint32_t own,
                     struct gpu_kernel **kernel, struct kiln_error *error);

/* Forgets the kernels: what they were made of has changed. */
void vulkan_forget_kernels(struct vulkan_backend *b);
/* A buffer of a slot, with at least `size` bytes (guarded: as many); what it held is lost. Nothing uses it. */
int vulkan_grow_buffer(struct vulkan_backend *b, struct gpu_buffer *buffer, size_t size, enum gpu_memory memory,
                       const char *what, struct kiln_error *error);
/* b->layout has changed. */
int vulkan_upload_root(struct vulkan_backend *b, struct kiln_error *error);
/* Brings what paths and chains ask of the scene and other kernels do not: the colours of all surfaces, their gloss and
 * their normals. In scenes with materials that are taken with their gloss they are there from the start. */
int vulkan_surfaces(struct vulkan_backend *b, struct kiln_error *error);
/* Rays that lie on the device: `count` origins, directions (struct kiln_vec3) and room for hits (struct kiln_gpu_hit).
 * One dispatch. */
int vulkan_intersect_on_device(struct vulkan_backend *b, uint64_t origins, uint64_t directions, uint64_t hits,
                               uint32_t count, double *seconds, struct kiln_error *error);

/* After a failure: whether trying again may help, for the device was lost or had too little memory, and not too often.
 */
bool vulkan_can_recover(const struct vulkan_backend *b);
/* Makes the device anew with all that was on it (but for buffers of passes); when memory was short, passes get half as
 * much from now on. Pointers to kernels and addresses are no longer valid. KILN_NO_DEVICE when that fails too. */
int vulkan_recover(struct vulkan_backend *b, struct kiln_error *error);

/* Runs what is left of a batch, and takes what was taken off *left. *refused: the taker failed, so that trying again is
 * of no use. */
typedef int (*vulkan_run_left)(struct vulkan_backend *b, const void *parameters, struct kiln_batch *left,
                               uint64_t *rays, bool *refused, struct kiln_error *error);
/* Runs a batch to its end, and goes on with a device made anew as long as that may help. For passes that are not over
 * tile runs; chunks.h does the same for those that are. */
int vulkan_run_to_end(struct vulkan_backend *b, vulkan_run_left run_left, const void *parameters,
                      const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);

/* Gives back what the bidirectional or the land pass keeps from one call to the next. */
void vulkan_bidirectional_release(struct vulkan_backend *b);

/* Answers of pixels from their sums on the device; adds up their rays. KILN_NO_DEVICE: the device has ended a loop
 * early. */
int vulkan_read_path_sums(const struct vulkan_backend *b, const struct kiln_gpu_path_sums *sums, size_t count,
                          struct kiln_path_result *results, uint64_t *rays, struct kiln_error *error);

/* Sobol' points 0 .. count-1 of all dimensions on the device: dimension d from word d * b->sobol_count on. */
int vulkan_sobol(struct vulkan_backend *b, uint32_t count, struct kiln_error *error);
/* The address of Sobol' point `first_sample` in dimension 0. */
static inline uint64_t vulkan_sobol_from(const struct vulkan_backend *b, uint32_t first_sample)
{
    return b->sobol.address + first_sample * sizeof(uint32_t);
}

/* How the samples of a point are dealt out on the device. */
static inline struct kiln_slices vulkan_slices_of(const struct vulkan_backend *b, uint32_t samples)
{
    return kiln_slices_of(samples, gpu_about(b->gpu)->software);
}

/* Makes what passes over the surface will ask for, as far as there is room for it (chunks.c). */
void vulkan_passes_ahead(struct vulkan_backend *b);

/* A kernel, as vulkan_kernel_of is asked for it. */
struct vulkan_wish {
    const struct vulkan_shader *shader;
    bool draw_again;
    uint32_t own;
    bool (*wanted)(const struct vulkan_backend *b); /* NULL: always */
};

/* Whether threads make kernels ahead of their use: software devices make theirs when they first run, and ray-tracing
 * kernels cannot be made by several threads. */
bool vulkan_has_makers(const struct vulkan_backend *b);
/* Whether only the surface tells what the kernel is made of. */
bool vulkan_hangs_on_surface(const struct vulkan_backend *b, const struct vulkan_wish *wish);
/* Begins to make kernels that are not there yet, all at once; vulkan_kernel_of waits for each. `wanted` is not asked.
 * They end at the first that has no shader. */
void vulkan_kernels_at_once(struct vulkan_backend *b, const struct vulkan_wish *wishes, size_t count);

/* A pass as this backend has it: vulkan_pass_validity in validity.c, vulkan_pass_direct in direct.c and so on. */
enum { VULKAN_WISHES = 6 };
struct vulkan_pass {
    /* Runs over a batch, all of whose items have batch->samples samples, calls its taker and adds its rays to *rays.
     * When the device is lost or short of memory it is made anew (vulkan_recover), and the pass goes on with what was
     * not taken. */
    int (*run)(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error);
    /* Kernels to make ahead where the pass is known to come, up to the first that has no shader; else they are made
     * when it first runs. */
    struct vulkan_wish ahead[VULKAN_WISHES];
    /* The same where the kernels hang on the pass's parameters (kiln_backend_expect); NULL: `ahead` says them all. */
    void (*expect)(struct vulkan_backend *b, const void *parameters);
    /* Gives back what it keeps on the device from one call to the next; NULL: nothing. */
    void (*release)(struct vulkan_backend *b);
    /* whether it runs with these parameters here (kiln_backend_takes); NULL: with any */
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
