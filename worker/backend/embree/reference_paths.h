/* The reference pass's paths that go both ways (worker/pass/reference.h: bdpt, vcm): what a surface point's sample
 * finds. The tile runs are reference.c's. */
#ifndef KILN_WORKER_BACKEND_EMBREE_REFERENCE_PATHS_H
#define KILN_WORKER_BACKEND_EMBREE_REFERENCE_PATHS_H

#include "worker/backend/embree/bidirectional_subpaths.h"
#include "worker/backend/embree/rays.h"
#include "worker/pass/reference.h"

/* Data that all threads of a call share, read while they run. Calls that want the same share it too: the backend keeps
 * the last one. */
struct reference_paths {
    struct kiln_reference_parameters wanted;
    uint64_t count; /* of paths of light that may be merged, in each quarter */
    uint32_t samples, first_sample;
    struct kiln_bidirectional_parameters parameters; /* of which method, radius and the camera's bounces are set */
    struct kiln_emission *emission;
    /* of the samples of each quarter, which have vertices to merge of their own */
    struct bidirectional of[RAY_QUARTERS];
    struct photon_grid *grids[RAY_QUARTERS];
    int status; /* a failure of a thread */
    struct kiln_error error;
};

/* Sets b->reference to what the method needs for the samples of a part, and traces the paths of light that may be
 * merged; nothing is done where that is there. Not for callers inside parallel regions. */
int reference_paths_want(struct embree_backend *b, const struct kiln_reference_parameters *parameters,
                         const struct kiln_batch *part, struct kiln_error *error);
/* Sets the pointer to NULL, which may be NULL. */
void reference_paths_destroy(struct reference_paths **paths);

/* Light of a point's sample: `radiance` along its ray, W/(m2 sr); `irradiance` and `incident` by connections of the
 * point itself, W/m2. `last` and `last_incident`: the parts that have left as many diffuse surfaces as there may be. */
struct reference_found {
    float radiance[3], last[3];
    double irradiance[3], incident[3], last_incident[3];
};

/* Follows the sample of lane l. `ray`: what its ray has met, on a side that is there; NULL: nothing that goes on. `w`:
 * the thread's paths, of which `all` is set to those of the sample's quarter. */
void reference_follow(struct subpaths *w, struct reference_paths *paths, const struct tile_run_rays *rays,
                      uint32_t step, uint32_t l, bool receives_only, const struct RTCRayHit *ray,
                      struct reference_found *found);

#endif
