/* Photons: vertices of light paths, stored for merging in a table of cells twice the radius wide. Within a cell they
 * are in the order of their paths. So sums over nearby photons have the same bits, whichever thread traced the paths.
 */
#ifndef KILN_WORKER_BACKEND_EMBREE_PHOTONS_H
#define KILN_WORKER_BACKEND_EMBREE_PHOTONS_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

struct photon {
    struct kiln_vec3 position, from; /* m; unit, towards the light's origin */
    float flux[3];                   /* W */
    float vcm, vm;                   /* of struct kiln_path_sums */
    uint32_t bounces;                /* struct vertex */
    uint32_t path, number;           /* numbers of the light path, and of its surface, from 0 */
};

/* Unordered photons of one thread. */
struct photon_list {
    struct photon *photons; /* owned: kiln_free */
    size_t count, capacity;
};
int photon_add(struct photon_list *list, const struct photon *photon, struct kiln_error *error);

struct photon_grid;
/* Copies the photons of the lists. Destroy with photon_grid_destroy. Not for callers inside parallel regions. */
int photon_grid_create(struct photon_grid **grid, const struct photon_list *lists, size_t count, double radius,
                       struct kiln_error *error);
void photon_grid_destroy(struct photon_grid **grid);

/* Calls `visit` for each photon within the radius of p. */
void photon_grid_near(const struct photon_grid *grid, struct kiln_vec3 p,
                      void (*visit)(void *context, const struct photon *photon), void *context);

#endif
