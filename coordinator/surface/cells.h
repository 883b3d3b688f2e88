/* The grid of radiance cells and its Morton order. */
#ifndef KILN_COORDINATOR_SURFACE_CELLS_H
#define KILN_COORDINATOR_SURFACE_CELLS_H

#include <stdint.h>

#include "worker/scene/geometry.h"

struct kiln_grid {
    struct kiln_dvec3 origin; /* relative to the scene's centre */
    double size;              /* m */
    uint64_t count[3];
};

/* Lays the grid over the geometry's bounds. `cell_size` in metres; 0: a 24th of the longest side, for kiln_grid_coarsen
 * to enlarge. KILN_BAD_INPUT for a size that is not a positive number or gives more than 2^20 cells along a side. Pure.
 */
int kiln_grid_choose(struct kiln_grid *grid, const struct kiln_geometry *geometry, double cell_size,
                     struct kiln_error *error);

/* Doubles the cells' size: a cell's code is then its old one shifted right by 3. */
void kiln_grid_coarsen(struct kiln_grid *grid);

static inline uint64_t kiln_spread3(uint64_t x) /* 21 bits to every third */
{
    x = (x | x << 32) & 0x1f00000000ffffu;
    x = (x | x << 16) & 0x1f0000ff0000ffu;
    x = (x | x << 8) & 0x100f00f00f00f00fu;
    x = (x | x << 4) & 0x10c30c30c30c30c3u;
    return (x | x << 2) & 0x1249249249249249u;
}

static inline uint64_t kiln_grid_axis(const struct kiln_grid *grid, int axis, double offset)
{
    const double i = floor(offset / grid->size), last = (double)(grid->count[axis] - 1);
    return i > 0.0 ? (uint64_t)(i < last ? i : last) : 0;
}

/* Morton code of the cell that holds `p` (relative to the centre; outside the grid: the nearest cell), x lowest. */
static inline uint64_t kiln_grid_code(const struct kiln_grid *grid, struct kiln_dvec3 p)
{
    return kiln_spread3(kiln_grid_axis(grid, 0, p.x - grid->origin.x)) |
           kiln_spread3(kiln_grid_axis(grid, 1, p.y - grid->origin.y)) << 1 |
           kiln_spread3(kiln_grid_axis(grid, 2, p.z - grid->origin.z)) << 2;
}

#endif
