/* Spheres about probes (worker/pass/spheres.h) on the device, and the light that paths deposit in them. */
#ifndef KILN_WORKER_BACKEND_VULKAN_SPHERES_H
#define KILN_WORKER_BACKEND_VULKAN_SPHERES_H

#include "worker/backend/vulkan/bidirectional.h"

struct kiln_aims;
struct kiln_probe_spheres;

/* Uploads the spheres, with sums of zero, to r->b->spheres, whose last buffer is a struct kiln_gpu_spheres. The numbers
 * of paths of all aims must be set. Release with vulkan_spheres_release, also after a failure. */
int vulkan_spheres_create(struct both_run *r, const struct kiln_aims *aims, const struct kiln_probe_spheres *spheres,
                          struct kiln_error *error);
/* Adds the deposited light to the sums and moments of `spheres`, and the rays traced for walls to *rays. After a
 * failure nothing has been added. */
int vulkan_spheres_add(struct vulkan_backend *b, const struct kiln_aims *aims, const struct kiln_probe_spheres *spheres,
                       uint64_t *rays, struct kiln_error *error);
void vulkan_spheres_release(struct vulkan_backend *b);

#endif
