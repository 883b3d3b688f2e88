#include "coordinator/surface/cells.h"

enum { CELLS_ALONG_LONGEST = 24, POINTS_PER_CELL = 1024 };
static const double most_along_side = 1048576.0, most_chosen = 1048576.0;

static double cells_along(double length, double size)
{
    return fmax(1.0, ceil(length / size - 1e-6)); /* a side of 24.0000001 cells has 24, the last one that much larger */
}

int kiln_grid_choose(struct kiln_grid *grid, const struct kiln_geometry *geometry, double cell_size, double area, double points,
                     struct kiln_error *error)
{
    const struct kiln_dvec3 low = dvec3_of(geometry->bounds_min), side = dvec3_sub(dvec3_of(geometry->bounds_max), low);
    const double longest = fmax(side.x, fmax(side.y, side.z));
    double size = cell_size;
    if (!(cell_size >= 0.0) || isinf(cell_size))
        return kiln_fail(error, KILN_BAD_INPUT, "the cell size %g is not a length: give metres above 0, or 0 to have it chosen",
                         cell_size);
    if (cell_size > 0.0 && cells_along(longest, cell_size) > most_along_side)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "cells of %g m are too small for a scene %g m long (at most 2^20 fit along a side): give at least %g m, or "
                         "0 to have the size chosen",
                         cell_size, longest, longest / most_along_side);
    if (cell_size == 0.0) {
        size = longest > 0.0 ? longest / CELLS_ALONG_LONGEST : 1.0;
        if (area > 0.0 && points > 0.0)
            size = fmax(size, sqrt(1.5 * POINTS_PER_CELL * (area / points))); /* a plane of any direction cuts 1.5 A / s2 cells */
        while (cells_along(side.x, size) * cells_along(side.y, size) * cells_along(side.z, size) > most_chosen)
            size *= 1.25;
    }
    *grid = (struct kiln_grid){.origin = low, .size = size};
    grid->count[0] = (uint64_t)cells_along(side.x, size);
    grid->count[1] = (uint64_t)cells_along(side.y, size);
    grid->count[2] = (uint64_t)cells_along(side.z, size);
    return KILN_OK;
}
