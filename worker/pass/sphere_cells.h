/* A grid of cells with lists of the probe spheres (spheres.h) that overlap them. A cell is a box about a place of the
 * probe grid, as large as the spacing. A sphere lies in one cell, or in several adjacent cells if its probe has been
 * moved. */
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

/* Tolerance, in spacings: a sphere that reaches less than this beyond a cell is not listed in the next one. So lookups
 * of a place must visit all cells within twice this distance. */
#define KILN_SPHERE_SLACK 1e-5

/* A sphere in the list of a cell. */
struct kiln_cell_sphere {
    struct kiln_sphere sphere;
    uint32_t number, again; /* again: 1: also in lists of other cells; else 0 */
};

/* Cells with their lists. One layer of cells is added on each side of the grid (along z: of the layers that have
 * spheres), since spheres at the edges reach there. */
struct kiln_sphere_cells {
    int64_t first[3], size[3]; /* grid place of the first cell; number of cells along each axis */
    uint32_t *begin;           /* first entry in `spheres` of each cell, x fastest; one entry more */
    struct kiln_cell_sphere *spheres;
};

/* Builds the cells from all spheres with a radius above 0. *cells must be zero, or made by this function. KILN_SYSTEM.
 * Release with kiln_sphere_cells_release, even after an error. */
int kiln_sphere_cells_make(struct kiln_sphere_cells *cells, const struct kiln_probe_spheres *spheres,
                           struct kiln_error *error);
void kiln_sphere_cells_release(struct kiln_sphere_cells *cells);

#endif
