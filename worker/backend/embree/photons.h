/* Vertices of paths of light, kept to be merged: a table of cells as wide as twice the radius, in each of which they
 * stand in the order of their paths. So sums over what is near have the same bits, whoever has traced the paths. */
#ifndef KILN_WORKER_BACKEND_EMBREE_PHOTONS_H
#define KILN_WORKER_BACKEND_EMBREE_PHOTONS_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

struct photon {
    struct kiln_vec3 position, from; /* m; unit, to where the light has come from */
    float flux[3];                   /* W */
    float vcm, vm;                   /* of struct kiln_path_sums */
    uint32_t bounces;                /* struct vertex */
    uint32_t path, number;           /* of the path of light, and of its surface, 0 the first */
};

/* Photons in no order, of one thread. */
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
