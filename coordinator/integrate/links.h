/* Links between surface points and nodes (worker/pass/links.h) over a bake: the tree, and what has been found for this
 * rank's own tile runs. They are kept from bounce to bounce; what moves to another rank, or was done before an
 * interruption, is found there again, with the same bits. */
#ifndef KILN_COORDINATOR_INTEGRATE_LINKS_H
#define KILN_COORDINATOR_INTEGRATE_LINKS_H

#include "coordinator/integrate/link_tree.h"
#include "worker/scene/surface.h"

struct kiln_links;

/* `points` and `light` as for kiln_link_tree_create; `points` and the surface are borrowed. `stream`: of the rays that
 * close rows. KILN_SYSTEM. */
int kiln_links_create(struct kiln_links **links, const struct kiln_surface *surface, const struct kiln_patch *points,
                      const float *light, double link_error, uint32_t stream, struct kiln_error *error);
/* NULL is accepted. */
void kiln_links_destroy(struct kiln_links **links);

/* Of memory, on each rank, for so many points in all, of which it has `own`; roughly, for its links are not found yet.
 */
uint64_t kiln_links_bytes_expected(uint64_t points, uint64_t own, double link_error);

/* Takes the radiosity of all points; the surface may be distributed anew since. Returns what the pass is run with,
 * which stands until the next call, or NULL. KILN_SYSTEM. */
int kiln_links_update(struct kiln_links *links, uint32_t bounce, kiln_link_of_point light, const void *context,
                      const struct kiln_links_parameters **parameters, struct kiln_error *error);

/* How many links of points there are on this rank, and the bytes that they take. */
void kiln_links_count(const struct kiln_links *links, uint64_t *count, uint64_t *bytes);

#endif
