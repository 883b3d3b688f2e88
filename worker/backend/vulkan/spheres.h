/* The spheres about probes (worker/pass/spheres.h) on the device, and what light paths leave there. */
#ifndef KILN_WORKER_BACKEND_VULKAN_SPHERES_H
#define KILN_WORKER_BACKEND_VULKAN_SPHERES_H

#include "worker/backend/vulkan/bidirectional.h"

struct kiln_aims;
struct kiln_probe_spheres;

/* Brings the spheres, with sums of zero, into r->b->spheres, of which the last is a struct kiln_gpu_spheres. The aims
 * are shared out. Release with vulkan_spheres_release, also after a failure. */
int vulkan_spheres_create(struct both_run *r, const struct kiln_aims *aims, const struct kiln_probe_spheres *spheres,
                          struct kiln_error *error);
/* Adds what paths have left to the sums and the moments of `spheres`, and to *rays those that have asked for walls.
 * After a failure nothing has been added. */
int vulkan_spheres_add(struct vulkan_backend *b, const struct kiln_aims *aims, const struct kiln_probe_spheres *spheres,
                       uint64_t *rays, struct kiln_error *error);
void vulkan_spheres_release(struct vulkan_backend *b);

#endif
