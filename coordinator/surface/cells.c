#include "coordinator/surface/cells.h"

enum { CELLS_ALONG_LONGEST = 24 };
static const double most_along_side = 1048576.0;

static double cells_along(double length, double size)
{
    /* a side that is 24.0000001 cells long has 24, the last one slightly larger */
    return fmax(1.0, ceil(length / size - 1e-6));
}

int kiln_grid_choose(struct kiln_grid *grid, const struct kiln_geometry *geometry, double cell_size,
                     struct kiln_error *error)
{
    const struct kiln_dvec3 low = dvec3_of(geometry->bounds_min), side = dvec3_sub(dvec3_of(geometry->bounds_max), low);
    const double longest = fmax(side.x, fmax(side.y, side.z));
    if (!(cell_size >= 0.0) || isinf(cell_size))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "the cell size %g is not a length: give metres above 0, or 0 to have it chosen", cell_size);
    if (cell_size > 0.0 && cells_along(longest, cell_size) > most_along_side)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "cells of %g m are too small for a scene %g m long (at most 2^20 fit along a side): "
                         "--cell-size %g would do, or "
                         "auto",
                         cell_size, longest, 1.001 * longest / most_along_side);
    const double size = cell_size > 0.0 ? cell_size : longest > 0.0 ? longest / CELLS_ALONG_LONGEST : 1.0;
    *grid = (struct kiln_grid){.origin = low, .size = size};
    grid->count[0] = (uint64_t)cells_along(side.x, size);
    grid->count[1] = (uint64_t)cells_along(side.y, size);
    grid->count[2] = (uint64_t)cells_along(side.z, size);
    return KILN_OK;
}

void kiln_grid_coarsen(struct kiln_grid *grid)
{
    grid->size *= 2.0;
    for (int axis = 0; axis < 3; axis++)
        grid->count[axis] = (grid->count[axis] + 1) / 2;
}
