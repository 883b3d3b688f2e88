/* Rays of the directions pass (worker/pass/directions.h): their directions and weights. */
#ifndef KILN_WORKER_BACKEND_EMBREE_DIRECTED_H
#define KILN_WORKER_BACKEND_EMBREE_DIRECTED_H

#include "worker/backend/embree/lookup.h"
#include "worker/pass/directions.h"

struct directed;

/* Parameters and batch are borrowed. Destroy with directed_destroy, which accepts NULL. */
int directed_create(struct directed **directed, const struct kiln_directions_parameters *parameters,
                    const struct kiln_batch *part, struct kiln_error *error);
void directed_destroy(struct directed **directed);

/* Begins a tile run, after rays_begin with the same tile run and stream. */
void directed_begin(struct directed *directed, const struct tile_run_rays *rays, const struct embree_backend *backend,
                    size_t tile_run, uint32_t stream);
/* Directs the rays of a step with `lanes` lanes to their targets, after rays_make. */
void directed_aim(struct directed *directed, struct tile_run_rays *rays, uint32_t step, uint32_t lanes);
/* Sets the rays' weights, after they were traced and their hits were looked up. */
void directed_weigh(const struct directed *directed, struct tile_run_rays *rays, const struct rays_found *found,
                    uint32_t lanes);
/* Returns the quarter to which lane l's sample belongs. All quarters have equally many samples of each kind. */
uint32_t directed_quarter(const struct directed *directed, const struct tile_run_rays *rays, uint32_t step, uint32_t l);

#endif
