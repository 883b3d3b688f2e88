/* The grid of radiance cells: equal cubes over the scene's bounds. A cell is numbered by its Morton code (Z-order
 * curve). */
#ifndef KILN_COORDINATOR_SURFACE_CELLS_H
#define KILN_COORDINATOR_SURFACE_CELLS_H

#include <stdint.h>

#include "worker/scene/geometry.h"

struct kiln_grid {
    struct kiln_dvec3 origin; /* lowest corner, m, relative to the scene's centre */
    double size;              /* side of a cell, m */
    uint64_t count[3];
};

/* Lays the grid over the geometry's bounds. `cell_size` is in metres; with 0 it becomes a 24th of the longest side,
 * which the caller may enlarge with kiln_grid_coarsen. KILN_BAD_INPUT for a size that is not a positive number or that
 * gives more than 2^20 cells along a side. Pure. */
int kiln_grid_choose(struct kiln_grid *grid, const struct kiln_geometry *geometry, double cell_size,
                     struct kiln_error *error);

/* Doubles the size of the cells. The new code of a cell is its old code shifted right by 3. */
void kiln_grid_coarsen(struct kiln_grid *grid);

/* Spreads the low 21 bits to every third bit, for Morton codes. */
static inline uint64_t kiln_morton_spread(uint64_t x)
{
    x = (x | x << 32) & 0x1f00000000ffffu;
    x = (x | x << 16) & 0x1f0000ff0000ffu;
    x = (x | x << 8) & 0x100f00f00f00f00fu;
    x = (x | x << 4) & 0x10c30c30c30c30c3u;
    return (x | x << 2) & 0x1249249249249249u;
}

/* Index along `axis` of the cell that holds `offset`, m from the grid's origin; outside the grid that of the nearest
 * cell. */
static inline uint64_t kiln_grid_axis(const struct kiln_grid *grid, int axis, double offset)
{
    const double i = floor(offset / grid->size), last = (double)(grid->count[axis] - 1);
    return i > 0.0 ? (uint64_t)(i < last ? i : last) : 0;
}

/* Morton code of the cell that holds `p` (m, relative to the scene's centre); outside the grid that of the nearest
 * cell. Bits of x are lowest. */
static inline uint64_t kiln_grid_code(const struct kiln_grid *grid, struct kiln_dvec3 p)
{
    return kiln_morton_spread(kiln_grid_axis(grid, 0, p.x - grid->origin.x)) |
           kiln_morton_spread(kiln_grid_axis(grid, 1, p.y - grid->origin.y)) << 1 |
           kiln_morton_spread(kiln_grid_axis(grid, 2, p.z - grid->origin.z)) << 2;
}

#endif
