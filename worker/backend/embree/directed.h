/* Rays of the directions pass (worker/pass/directions.h): where they go, and what they weigh. */
#ifndef KILN_WORKER_BACKEND_EMBREE_DIRECTED_H
#define KILN_WORKER_BACKEND_EMBREE_DIRECTED_H

#include "worker/backend/embree/lookup.h"
#include "worker/pass/directions.h"

struct directed;

/* Parameters and batch are borrowed. Destroy with directed_destroy, which accepts NULL. */
int directed_create(struct directed **directed, const struct kiln_directions_parameters *parameters,
                    const struct kiln_batch *part, struct kiln_error *error);
void directed_destroy(struct directed **directed);

/* After rays_begin with the same tile run and stream. */
void directed_begin(struct directed *directed, const struct tile_run_rays *rays, const struct embree_backend *backend,
                    size_t tile_run, uint32_t stream);
/* After rays_make of a step with so many lanes: sends its rays to where they should go. */
void directed_aim(struct directed *directed, struct tile_run_rays *rays, uint32_t step, uint32_t lanes);
/* After the rays were traced, and what they met was found: sets their weights. */
void directed_weigh(const struct directed *directed, struct tile_run_rays *rays, const struct rays_found *found,
                    uint32_t lanes);
/* Which quarter of the samples lane l's is of: each has as many of either kind. */
uint32_t directed_quarter(const struct directed *directed, const struct tile_run_rays *rays, uint32_t step, uint32_t l);

#endif
