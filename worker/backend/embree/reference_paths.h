/* Bidirectional paths of the reference pass (worker/pass/reference.h: bdpt, vcm): the light of a surface point's
 * sample. reference.c processes the tile runs. */
#ifndef KILN_WORKER_BACKEND_EMBREE_REFERENCE_PATHS_H
#define KILN_WORKER_BACKEND_EMBREE_REFERENCE_PATHS_H

#include "worker/backend/embree/bidirectional_subpaths.h"
#include "worker/backend/embree/rays.h"
#include "worker/pass/reference.h"

/* Data that all threads of a call share and only read. Calls with the same parameters share it, too: the backend keeps
 * the last one. */
struct reference_paths {
    struct kiln_reference_parameters wanted;
    uint64_t count; /* number of light paths for merging, in each quarter */
    uint32_t samples, first_sample;
    struct kiln_bidirectional_parameters parameters; /* only method, radius and the camera's bounces are set */
    struct kiln_emission *emission;
    /* for the samples of each quarter, which has its own vertices for merging */
    struct bidirectional of[RAY_QUARTERS];
    struct photon_grid *grids[RAY_QUARTERS];
    int status; /* a failure of a thread */
    struct kiln_error error;
};

/* Sets b->reference to the method's data for the samples of a part, and traces the light paths for merging, unless that
 * is already there. Not for callers inside parallel regions. */
int reference_paths_want(struct embree_backend *b, const struct kiln_reference_parameters *parameters,
                         const struct kiln_batch *part, struct kiln_error *error);
/* Destroys the data and sets the pointer, which may be NULL, to NULL. */
void reference_paths_destroy(struct reference_paths **paths);

/* Light of a point's sample: `radiance` along its ray, W/(m2 sr); `irradiance` and `incident` by connections of the
 * point itself, W/m2. `last` and `last_incident`: the parts with the maximum number of diffuse scatterings. */
struct reference_found {
    float radiance[3], last[3];
    double irradiance[3], incident[3], last_incident[3];
};

/* Traces the sample of lane l. `ray`: its first ray's hit, on a side with a surface; NULL: the path does not continue.
 * `w`: the thread's paths, of which `all` is set to those of the sample's quarter. */
void reference_follow(struct subpaths *w, struct reference_paths *paths, const struct tile_run_rays *rays,
                      uint32_t step, uint32_t l, bool receives_only, const struct RTCRayHit *ray,
                      struct reference_found *found);

#endif
