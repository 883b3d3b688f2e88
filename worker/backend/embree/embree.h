/* The Embree backend: private declarations shared by its files, one file a pass (as every backend folder has them). */
#ifndef KILN_WORKER_BACKEND_EMBREE_EMBREE_H
#define KILN_WORKER_BACKEND_EMBREE_EMBREE_H

#include <embree3/rtcore.h>

#include "worker/backend/backend.h"
#include "worker/base/clones.h"
#include "worker/light/lights.h"

enum { PACKET = 8 }; /* rays traced together; 8 beat 1, 4 and 16 on AVX2 in Cornell box and Sponza */

struct embree_backend {
    struct kiln_backend base;
    struct kiln_backend_params params;
    const struct kiln_surface *surface;
    const uint64_t *radiosity;
    RTCDevice device;
    RTCScene scene;
    uint32_t threads;
    bool coherent; /* so few triangles that packets stay together all the way down */
    double build_seconds;
    double thread_seconds; /* see kiln_backend_info */
    char device_text[128];
};

/* World triangle of a hit: geometry 0 holds the opaque ones, geometry 1 those with alpha. */
static inline uint32_t embree_triangle(const struct embree_backend *b, unsigned geometry, unsigned primitive)
{
    return geometry == 0 ? primitive : (uint32_t)b->params.geometry->opaque_count + primitive;
}

/* Sets flush-to-zero in the calling thread, as Embree wants, and puts back what was there. */
unsigned embree_enter(void);
void embree_leave(unsigned saved);

/* Processor time of the calling thread, s. */
double embree_thread_seconds(void);

/* Hands a batch to `trace` in parts of some 65,536 points, and each part's answers to the batch's taker. */
typedef int (*embree_trace_part)(struct embree_backend *b, size_t tile_run_first, size_t tile_run_count,
                                 uint32_t samples, uint32_t stream, struct kiln_point_result *results, uint64_t *rays,
                                 struct kiln_error *error);
int embree_in_parts(struct embree_backend *b, const struct kiln_batch *batch, uint32_t samples, uint32_t stream,
                    embree_trace_part trace, uint64_t *rays, struct kiln_error *error);

int embree_validity(struct kiln_backend *backend, size_t tile_run_first, size_t tile_run_count, uint16_t *visible,
                    struct kiln_error *error);
int embree_direct(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint64_t *rays,
                  struct kiln_error *error);
int embree_gather(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint32_t stream,
                  uint64_t *rays, struct kiln_error *error);
int embree_probes(struct kiln_backend *backend, const struct kiln_vec3 *positions, size_t count, uint64_t index_first,
                  uint32_t samples, struct kiln_probe_result *results, uint64_t *rays, struct kiln_error *error);

int embree_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint32_t stream,
                   double *seconds, uint64_t *rays, struct kiln_error *error);

#endif
