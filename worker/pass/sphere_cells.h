/* Which spheres of probes (spheres.h) lie in which cells: about each place of the grid a box as large as the spacing.
 * A sphere lies in one cell, or in some that are next to each other where its probe has been moved. */
#ifndef KILN_WORKER_PASS_SPHERE_CELLS_H
#define KILN_WORKER_PASS_SPHERE_CELLS_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

struct kiln_probe_spheres;

struct kiln_sphere {
    float centre[3]; /* m from the scene's centre: where the probe's light is gathered */
    float radius;    /* m; 0: the probe gets nothing */
};

/* Reach of a sphere beyond a cell that is not looked at, in spacings: who asks for the cells of a place asks for those
 * within twice as much of it. */
#define KILN_SPHERE_SLACK 1e-5

/* A sphere in the list of a cell. */
struct kiln_cell_sphere {
    struct kiln_sphere sphere;
    uint32_t number, again; /* again: 1: it is in the lists of other cells, too; else 0 */
};

/* There is a cell more on each side of the grid, along z of the layers that have spheres: spheres at its edges reach
 * there. */
struct kiln_sphere_cells {
    int64_t first[3], size[3]; /* place in the grid of the first cell, and how many there are along each axis */
    uint32_t *begin;           /* of each cell, x the fastest, and one more: where its spheres are in `spheres` */
    struct kiln_cell_sphere *spheres;
};

/* Makes the cells of all spheres that have a radius. Zero before, or made before. KILN_SYSTEM. Release with
 * kiln_sphere_cells_release, in any case. */
int kiln_sphere_cells_make(struct kiln_sphere_cells *cells, const struct kiln_probe_spheres *spheres,
                           struct kiln_error *error);
void kiln_sphere_cells_release(struct kiln_sphere_cells *cells);

#endif
