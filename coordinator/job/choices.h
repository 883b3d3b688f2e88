/* Enumerations of option values that other rooms use too. */
#ifndef KILN_COORDINATOR_JOB_CHOICES_H
#define KILN_COORDINATOR_JOB_CHOICES_H

#include <stdbool.h>
#include <stdint.h>

/* The integrators, by their names for --method; the first is the default. Each is a struct kiln_integrator_NAME
 * (coordinator/integrate/integrator.h). */
#define KILN_METHOD_LIST(DO) DO(cells) DO(radiosity) DO(path) DO(bdpt) DO(vcm)

/* --sky-patches: patches of the sky (worker/light/sky_patches.h). */
enum kiln_sky_patches { KILN_SKY_WHOLE = 0, KILN_SKY_145 = 1, KILN_SKY_577 = 2, KILN_SKY_2305 = 3 };

/* --method radiosity: how lamps that are surfaces light others: by samples of the direct pass, or as patches. */
enum kiln_lights_choice { KILN_LIGHTS_SAMPLED = 0, KILN_LIGHTS_PATCHES = 1 };

/* Likewise: what stands for the patches of a window of texels (coordinator/integrate/patches/patches.h). */
enum kiln_undersample { KILN_SAMPLE_ALL = 0, KILN_SAMPLE_STRIDE = 1, KILN_SAMPLE_RANDOM = 2, KILN_SAMPLE_MIPMAP = 3 };

/* Likewise: what points gather from: all patches, or nodes of a tree of them (coordinator/integrate/patches/links.h).
 */
enum kiln_patches_choice { KILN_PATCHES_ALL = 0, KILN_PATCHES_LINKS = 1 };
/* Likewise: what a point gathers by: pairs of patches; rays by the cosine, by even sets of directions over the
 * hemisphere or the disk under it, or by the cosine and to bright patches (worker/pass/directions.h). */
enum kiln_gather_choice {
    KILN_GATHER_PAIRS = 0,
    KILN_GATHER_COSINE = 1,
    KILN_GATHER_EVEN = 2,
    KILN_GATHER_CIRCLES = 3,
    KILN_GATHER_MIXED = 4
};

/* Likewise: in what order patches send: all at once, bounce by bounce, or those with the most unshot power first
 * (coordinator/integrate/radiosity/unshot.h). */
enum kiln_order { KILN_ORDER_LOCKSTEP = 0, KILN_ORDER_UNSHOT = 1 };

/* Likewise: what says whether two patches see each other: a ray, or voxels (worker/scene/voxels.h). */
enum kiln_visibility { KILN_VISIBILITY_RAYS = 0, KILN_VISIBILITY_VOXELS = 1 };

struct kiln_patch_settings {
    int patches;         /* enum kiln_patches_choice */
    double link_error;   /* with links: of a point's light, relative */
    int lights;          /* enum kiln_lights_choice */
    int undersample;     /* enum kiln_undersample */
    int window;          /* log2 of the texels a side of a window */
    double subdivide;    /* by how much what is one node may deviate; 0: nodes are not chosen by that */
    bool keep_nodes;     /* kiln.h5 has the nodes of the last step */
    int node_max;        /* with it: log2 of the texels a side of a node, at most */
    bool clamp;          /* Kahl's largest factor and contribution */
    double albedo_scale; /* factor of what is reflected */
    /* GiB of a rank, for what pairs see each other (worker/pass/visibility_cache.h); 0: none */
    double visibility_cache;
    int gather;          /* enum kiln_gather_choice */
    uint32_t directions; /* rays of a point in a step, unless by pairs; 0: as many as a bounce has */
    int visibility;      /* enum kiln_visibility */
    uint32_t voxels;     /* with KILN_VISIBILITY_VOXELS: along the scene's longest side */
    int order;           /* enum kiln_order */
    double unshot_left;  /* with KILN_ORDER_UNSHOT: of all reflected power, the unshot share with which rounds end */
};

/* How views are drawn, with their names for --method of kiln view; the first is the default: from the lightmaps of a
 * bake, by path tracing (coordinator/view/path_view.h), or by bidirectional paths, in the order of enum
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
/* How texels of lightmaps are shown: mixed with their neighbours, or as squares. */
enum kiln_view_filter_choice { KILN_VIEW_FILTER_LINEAR = 0, KILN_VIEW_FILTER_NEAREST = 1 };
/* Denoiser of path-traced views: none, or coordinator/view/bmfr.h. */
enum kiln_view_denoise { KILN_VIEW_DENOISE_NONE = 0, KILN_VIEW_DENOISE_BMFR = 1 };
static inline bool kiln_view_is_bidirectional(int method) { return method >= KILN_VIEW_METHOD_light; }

/* Where light lives (worker/store/store.h). VERTEX: in octrees while it is computed, and from there it is fitted to the
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

/* Whose radiosity a node receives: that of all points, or of those in patches of surface that its points see. */
enum kiln_exchange_points { KILN_EXCHANGE_ALL = 0, KILN_EXCHANGE_VISIBLE = 1 };

/* Whether points are repartitioned among ranks between steps: if it saves time, never, or after every step (for tests).
 */
enum kiln_rebalance { KILN_REBALANCE_AUTO = 0, KILN_REBALANCE_NEVER = 1, KILN_REBALANCE_ALWAYS = 2 };

/* Directions of light in a bake: none, one for each point, or spherical harmonics of bands 0 and 1. */
enum kiln_directional { KILN_DIRECTIONAL_NONE = 0, KILN_DIRECTIONAL_DOMINANT = 1, KILN_DIRECTIONAL_SH1 = 2 };

/* How the light is found that mirrors, gloss and glass send on from lights to diffuse surfaces: not at all, by
 * gather rays that go on from there (shaders/shared/chain.h), by light paths that land in texels (worker/pass/land.h),
 * by those, spread over what is near (coordinator/integrate/land/merge.h), or by rays and paths, each weighed
 * (worker/pass/weighed.h). AUTO: the latter. Light paths are traced from LAND on. */
enum kiln_caustics {
    KILN_CAUSTICS_AUTO = 0,
    KILN_CAUSTICS_NONE = 1,
    KILN_CAUSTICS_GATHER = 2,
    KILN_CAUSTICS_LAND = 3,
    KILN_CAUSTICS_MERGE = 4,
    KILN_CAUSTICS_VCM = 5
};

/* Radii that are not given in m: by what lands, and so small that nothing is merged beyond its texel. */
#define KILN_MERGE_RADIUS_AUTO 0.0
#define KILN_MERGE_RADIUS_TEXEL (-1.0)

/* --iterations: more from round to round of a bake with a target error (integrate/parts/rounds.h); and how many there
 * are in a step of the first round then, which --iterations has as its default too. */
#define KILN_ITERATIONS_ALL UINT32_MAX
enum { KILN_ITERATIONS_FIRST = 16 };

/* Denoiser of lightmaps: none; surface regression (coordinator/output/map/denoise/regression.h); or regression unless
 * --quality is reference. */
enum kiln_denoise { KILN_DENOISE_NONE = 0, KILN_DENOISE_REGRESSION = 1, KILN_DENOISE_AUTO = 2 };

/* Where gather rays end, and the probes that answer for what lies farther away (worker/pass/gather.h). */
struct kiln_radiance_settings {
    double range;     /* m, from 0 on; INFINITY: rays have no end, and there are no probes */
    double spacing;   /* m between probes; 0: chosen automatically */
    int basis;        /* what probes keep: KILN_PROBE_HARMONICS, ... of shaders/shared/radiance_probe.h */
    uint32_t side;    /* elements along a side of a probe's map; 0: the default of the basis */
    bool approximate; /* probes look towards a place at a fixed distance along the ray, not where it leaves the scene */
    uint32_t samples; /* rays of a probe, about; 0: there are no probes, whatever the range */
};

enum kiln_schedule {
    KILN_SCHEDULE_LEAN = 0, /* bounces with few rays, the energy tail, one final gather with many rays */
    KILN_SCHEDULE_EQUAL = 1 /* the same number of rays in every bounce, no tail, no final gather: the reference mode */
};

/* Encodings of pages of lightmaps: coordinator/export/page_format.h. */
enum kiln_page_format { KILN_PAGE_EXR, KILN_PAGE_EXR_HALF, KILN_PAGE_RGBM, KILN_PAGE_RGBE, KILN_PAGE_KTX2 };

#endif
