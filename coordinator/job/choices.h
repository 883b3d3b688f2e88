/* Enumerations of option values that other directories use too. */
#ifndef KILN_COORDINATOR_JOB_CHOICES_H
#define KILN_COORDINATOR_JOB_CHOICES_H

#include <stdbool.h>
#include <stdint.h>

/* The integrators, by their names for --method; the first is the default. Each is a struct kiln_integrator_NAME
 * (coordinator/integrate/integrator.h). */
#define KILN_METHOD_LIST(DO) DO(cells) DO(radiosity) DO(path) DO(bdpt) DO(vcm)

/* --sky-patches: patches of the sky (worker/light/sky_patches.h). */
enum kiln_sky_patches { KILN_SKY_WHOLE = 0, KILN_SKY_145 = 1, KILN_SKY_577 = 2, KILN_SKY_2305 = 3 };

/* --method radiosity: how emitting surfaces light others: sampled by the direct pass, or as patches. */
enum kiln_lights_choice { KILN_LIGHTS_SAMPLED = 0, KILN_LIGHTS_PATCHES = 1 };

enum { KILN_ROUND_LEVELS = 40 }; /* of samples: coordinator/integrate/parts/rounds.h */

/* --rounds: levels of the rounds after the first, in ascending order. */
struct kiln_round_list {
    bool given; /* else the error decides, and the clock */
    uint32_t count;
    uint8_t levels[KILN_ROUND_LEVELS];
};

/* --method radiosity: representation of the patches in a window of texels (coordinator/integrate/patches/patches.h). */
enum kiln_undersample { KILN_SAMPLE_ALL = 0, KILN_SAMPLE_STRIDE = 1, KILN_SAMPLE_RANDOM = 2, KILN_SAMPLE_MIPMAP = 3 };

/* --method radiosity: sources of a gather: all patches, or nodes of a tree (coordinator/integrate/patches/links.h). */
enum kiln_patches_choice { KILN_PATCHES_ALL = 0, KILN_PATCHES_LINKS = 1 };
/* --method radiosity: method of gathering: pairs of patches; rays by the cosine, by even sets of directions over the
 * hemisphere or the disk under it, or by the cosine and to bright patches (worker/pass/directions.h). */
enum kiln_gather_choice {
    KILN_GATHER_PAIRS = 0,
    KILN_GATHER_COSINE = 1,
    KILN_GATHER_EVEN = 2,
    KILN_GATHER_CIRCLES = 3,
    KILN_GATHER_MIXED = 4
};

/* --method radiosity: order in which patches send: all at once, bounce by bounce, or by most unshot power
 * (coordinator/integrate/radiosity/unshot.h). */
enum kiln_order { KILN_ORDER_LOCKSTEP = 0, KILN_ORDER_UNSHOT = 1 };

/* --method radiosity: visibility test of two patches: a ray, or voxels (worker/scene/voxels.h). */
enum kiln_visibility { KILN_VISIBILITY_RAYS = 0, KILN_VISIBILITY_VOXELS = 1 };

struct kiln_patch_settings {
    int patches;         /* enum kiln_patches_choice */
    double link_error;   /* with links: relative error of a point's light */
    int lights;          /* enum kiln_lights_choice */
    int undersample;     /* enum kiln_undersample */
    int window;          /* log2 of the texels a side of a window */
    double subdivide;    /* largest deviation within a node; 0: no such limit */
    bool keep_nodes;     /* store the nodes of the last step in kiln.h5 */
    int node_max;        /* with subdivide: log2 of the largest side of a node, texels */
    bool clamp;          /* clamp the form factor and contribution as Kahl does */
    double albedo_scale; /* factor on reflected light */
    /* GiB of a rank for the cached visibility of pairs (worker/pass/visibility_cache.h); 0: none */
    double visibility_cache;
    int gather;          /* enum kiln_gather_choice */
    uint32_t directions; /* rays per point in a step, except by pairs; 0: as in a bounce */
    int visibility;      /* enum kiln_visibility */
    uint32_t voxels;     /* with KILN_VISIBILITY_VOXELS: along the scene's longest side */
    int order;           /* enum kiln_order */
    double unshot_left;  /* with KILN_ORDER_UNSHOT: fraction of all reflected power; rounds end when less is unshot */
};

/* Rendering methods of views, with their names for --method of kiln view; the first is the default: from the lightmaps
 * of a bake, by path tracing (coordinator/view/path_view.h), or by bidirectional paths, in the order of enum
 * kiln_bidirectional_method (worker/pass/bidirectional.h). */
#define KILN_VIEW_METHOD_LIST(DO)                                                                                      \
    DO(lightmaps, "lightmaps")                                                                                         \
    DO(path, "path")                                                                                                   \
    DO(light, "light")                                                                                                 \
    DO(bdpt, "bdpt") DO(vcm, "vcm") DO(vcm_single, "vcm-single") DO(ppm, "ppm") DO(sppm, "sppm")
#define KILN_VIEW_METHOD_OF(name, text) KILN_VIEW_METHOD_##name,
enum kiln_view_method { KILN_VIEW_METHOD_LIST(KILN_VIEW_METHOD_OF) KILN_VIEW_METHODS };
#undef KILN_VIEW_METHOD_OF
static inline bool kiln_view_is_traced(int method) { return method != KILN_VIEW_METHOD_lightmaps; }
/* Filter for texels of lightmaps in views: interpolated with their neighbours, or as squares. */
enum kiln_view_filter_choice { KILN_VIEW_FILTER_LINEAR = 0, KILN_VIEW_FILTER_NEAREST = 1 };
/* Denoiser of path-traced views: none, or coordinator/view/bmfr.h. */
enum kiln_view_denoise { KILN_VIEW_DENOISE_NONE = 0, KILN_VIEW_DENOISE_BMFR = 1 };
static inline bool kiln_view_is_bidirectional(int method) { return method >= KILN_VIEW_METHOD_light; }

/* Store of the light (worker/store/store.h). VERTEX: octrees during the computation, whose light is then fitted to the
 * vertices (coordinator/output/vertex_light.h). */
enum kiln_store_kind { KILN_STORE_KIND_LIGHTMAP = 0, KILN_STORE_KIND_OCTREE = 1, KILN_STORE_KIND_VERTEX = 2 };

/* Format in which ranks exchange radiosity: COMPACT has 4 bytes a point, FULL 8. AUTO is compact for 2^22 surface
 * points or more. With fewer points its rounding is visible in the energy ratio of two bounces, which the tail
 * magnifies a hundred times for an albedo of 0.99; with more points it averages out. */
enum kiln_exchange_form { KILN_EXCHANGE_AUTO = 0, KILN_EXCHANGE_COMPACT = 1, KILN_EXCHANGE_FULL = 2 };

static inline bool kiln_exchange_is_compact(int form, uint64_t points)
{
    return form == KILN_EXCHANGE_COMPACT || (form == KILN_EXCHANGE_AUTO && points >= 1u << 22);
}

/* Data kept beside a bake so that its light can be relit: none; the hits of all gather rays
 * (integrate/relight/transport.h); or the links of --patches links (integrate/patches/link_file.h). */
enum kiln_keep { KILN_KEEP_NONE = 0, KILN_KEEP_ROWS = 1, KILN_KEEP_LINKS = 2 };

/* Radiosity that a node receives: that of all points, or only of the patches of surface that its points see. */
enum kiln_exchange_points { KILN_EXCHANGE_ALL = 0, KILN_EXCHANGE_VISIBLE = 1 };

/* Whether points are repartitioned among ranks between steps: if it saves time, never, or after every step (for tests).
 */
enum kiln_rebalance { KILN_REBALANCE_AUTO = 0, KILN_REBALANCE_NEVER = 1, KILN_REBALANCE_ALWAYS = 2 };

/* Directions of light in a bake: none, one for each point, or spherical harmonics of bands 0 and 1. */
enum kiln_directional { KILN_DIRECTIONAL_NONE = 0, KILN_DIRECTIONAL_DOMINANT = 1, KILN_DIRECTIONAL_SH1 = 2 };

/* Method for caustics, the light that mirrors, gloss and glass send from lights to diffuse surfaces: none; gather rays
 * that continue from there (shaders/shared/chain.h); light paths that land in texels (worker/pass/land.h); such paths,
 * spread over nearby points (coordinator/integrate/land/merge.h); or rays and paths with weights
 * (worker/pass/weighed.h). AUTO: the last one. Light paths are traced from LAND on. */
enum kiln_caustics {
    KILN_CAUSTICS_AUTO = 0,
    KILN_CAUSTICS_NONE = 1,
    KILN_CAUSTICS_GATHER = 2,
    KILN_CAUSTICS_LAND = 3,
    KILN_CAUSTICS_MERGE = 4,
    KILN_CAUSTICS_VCM = 5
};

/* Special values of the merge radius: chosen by the landings; or so small that nothing is merged beyond its texel. */
#define KILN_MERGE_RADIUS_AUTO 0.0
#define KILN_MERGE_RADIUS_TEXEL (-1.0)

/* --iterations: KILN_ITERATIONS_ALL lets them grow from round to round of a bake with a target error
 * (integrate/parts/rounds.h). KILN_ITERATIONS_FIRST: iterations per step of its first round, and the default of
 * --iterations. */
#define KILN_ITERATIONS_ALL UINT32_MAX
enum { KILN_ITERATIONS_FIRST = 16 };

/* Denoiser of lightmaps: none; surface regression (coordinator/output/map/denoise/regression.h); or regression unless
 * --quality is reference. */
enum kiln_denoise { KILN_DENOISE_NONE = 0, KILN_DENOISE_REGRESSION = 1, KILN_DENOISE_AUTO = 2 };

/* Range of gather rays, and the radiance probes used for light from farther away (worker/pass/gather.h). */
struct kiln_radiance_settings {
    double range;     /* m, from 0 on; INFINITY: unlimited rays, no probes */
    double spacing;   /* m between probes; 0: chosen automatically */
    int basis;        /* data format of probes: KILN_PROBE_HARMONICS, ... of shaders/shared/radiance_probe.h */
    uint32_t side;    /* elements along a side of a probe's map; 0: the default of the basis */
    bool approximate; /* look up probes at a fixed distance along the ray, not where it leaves the scene */
    uint32_t samples; /* rays per probe, about; 0: no probes, whatever the range */
};

enum kiln_schedule {
    KILN_SCHEDULE_LEAN = 0, /* bounces with few rays, the energy tail, one final gather with many rays */
    KILN_SCHEDULE_EQUAL = 1 /* the same number of rays in every bounce, no tail, no final gather: the reference mode */
};

/* Encodings of pages of lightmaps: coordinator/export/page_format.h. */
enum kiln_page_format { KILN_PAGE_EXR, KILN_PAGE_EXR_HALF, KILN_PAGE_RGBM, KILN_PAGE_RGBE, KILN_PAGE_KTX2 };

#endif
