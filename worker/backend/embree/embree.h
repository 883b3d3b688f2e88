/* The Embree backend: private declarations that its files share.
 *
 * One file a pass, with the same names as in every backend's folder: validity.c, direct.c, gather.c, guided.c,
 * directions.c, caustic.c, weighed.c, reference.c, probes.c, occlusion.c, directional.c, path.c, radiance.c, land.c,
 * bidirectional.c, patches.c, links.c; and shapes.c, which devices do not have. Files that passes share: - life:
 * embree.c (the list of passes, life of the backend, running a pass in parts), core.c (what all files use),
 *   devices.c (the CPU), intersect.c (closest hits), clearance.c, ceiling.c (tracing alone, for benches);
 * - rays: tile_runs.c (threads over the tile runs of a part), frame.c (a tile run's points made ready for sampling),
 *   rays.c (rays over the hemisphere of its points), lookup.c (radiosity at their hits), hemisphere.c (their sums, and
 *   how they go on), run_guide.c, ray_probes.c, directed.c, kept_rows.c and kept_chains.c (guides, radiance probes,
 *   other directions and kept rays of the gather pass), passage.c (rays through surfaces that let light through),
 *   coincident.c (fronts before backs where both coincide);
 * - light: light_samples.h (straight from the lights), shadow.c (shadow rays in packets), mirror_images.c (lamps that
 *   flat mirrors show);
 * - paths: meeting.c, walk.c and chain.c (rays that go on from surface to surface), chain_weighed.c, reference_paths.c,
 *   spheres.c (what light paths leave at probes), bidirectional_eye.c, bidirectional_light.c,
 *   bidirectional_vertex.c (paths from the camera, of light, and their vertices), photons.c (what is merged). */
#ifndef KILN_WORKER_BACKEND_EMBREE_EMBREE_H
#define KILN_WORKER_BACKEND_EMBREE_EMBREE_H

#include <embree3/rtcore.h>

#include "worker/backend/api.h"
#include "worker/backend/extended.h"
#include "worker/base/clones.h"
#include "worker/light/lights.h"
#include "worker/material/surface_bsdf.h"
#include "worker/store/store.h"

enum { PACKET = 8 }; /* rays traced together; 8 beat 1, 4 and 16 on AVX2 in Cornell box and Sponza */

struct embree_backend {
    struct kiln_backend base;
    struct kiln_backend_params params;
    const struct kiln_surface *surface;
    struct kiln_store store; /* store of the surface */
    const uint64_t *radiosity;
    const struct kiln_radiance_probes *probes; /* NULL: gather rays have unlimited length */
    RTCDevice device;
    RTCScene scene;
    uint16_t *coincides;               /* coincidence flags of triangles, found on demand (coincident.c); NULL: none */
    struct kiln_gloss_lobes *lobes;    /* lobes of each material; NULL: all materials are diffuse */
    struct reference_paths *reference; /* data of the last reference pass (reference.h); NULL: none */
    uint32_t threads;
    bool coherent; /* so few triangles that packets stay coherent throughout the traversal */
    bool compact;  /* the BVH takes less memory, and rays more time (worker/NOTES.md) */
    double build_seconds;
    double thread_seconds; /* see kiln_backend_info */
    char device_text[128];
};

/* World triangle of a hit: geometry 0 holds the opaque ones, geometry 1 those with alpha. */
static inline uint32_t embree_triangle(const struct embree_backend *b, unsigned geometry, unsigned primitive)
{
    return geometry == 0 ? primitive : (uint32_t)b->params.geometry->opaque_count + primitive;
}

/* embree_enter sets flush-to-zero in the calling thread, as Embree requires, and returns the previous state;
 * embree_leave restores it. */
unsigned embree_enter(void);
void embree_leave(unsigned saved);

/* Processor time of the calling thread, s. */
double embree_thread_seconds(void);

/* Passes: embree_validity in validity.c, embree_direct in direct.c and so on. Each computes the results of one part of
 * a batch. All items of the part have part->samples samples. The function adds its rays to *rays. `results` is an array
 * of the pass's result struct, one for each point or position of the part; it is not cleared. The taker is not called:
 * see embree_run in embree.c. */
#define EMBREE_DECLARE(name)                                                                                           \
    int embree_##name(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,  \
                      uint64_t *rays, struct kiln_error *error);
KILN_PASS_LIST(EMBREE_DECLARE)
#undef EMBREE_DECLARE

/* kiln_backend_intersect (intersect.c). */
int embree_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins, const struct kiln_vec3 *directions,
                     size_t count, const struct kiln_ray_hints *hints, struct kiln_hit *hits, struct kiln_error *error);
/* kiln_backend_clearance (clearance.c). */
int embree_clearance(struct kiln_backend *backend, const struct kiln_sphere *spheres, size_t count, float *clear,
                     struct kiln_error *error);
/* kiln_backend_devices (devices.c). */
int embree_devices(struct kiln_device *list, size_t room, size_t *count, struct kiln_error *error);
/* kiln_backend_ceiling (ceiling.c). */
int embree_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                   struct kiln_error *error);

#endif
