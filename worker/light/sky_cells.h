/* Cells of the sky: an environment image cut into regions of similar directions, among which light paths are shared out
 * (worker/light/aims.h).
 *
 * A cell is a rectangle of the image's texels. First a sun, a small region much brighter than the rest, is cut out by
 * four cuts. Then, again and again, the cell with the largest angular spread is cut where the parts have the least. The
 * spread of a cell is the luminance of its flux minus the length of the sum of flux times direction. Within a cell
 * directions are drawn by luminance, as of the whole image (shaders/shared/environment.h).
 *
 * Not collective; a pure function of the lights and `most`. Read by several threads at once. */
#ifndef KILN_WORKER_LIGHT_SKY_CELLS_H
#define KILN_WORKER_LIGHT_SKY_CELLS_H

#include "worker/light/lights.h"

struct kiln_sky_cell {
    uint32_t x0, x1, y0, y1; /* texels [x0, x1) of rows [y0, y1) */
    double share;            /* of the image's luminance */
    size_t first_row;        /* in `until` */
};

struct kiln_sky_cells {
    const struct kiln_lights *lights; /* borrowed */
    size_t count;                     /* 0: there is no image */
    struct kiln_sky_cell *all;
    double *until; /* by row of each cell: cumulative share of the cell, the row included */
};

/* At most `most` cells, at least one where there is an image. Borrows the lights. KILN_SYSTEM. Release with
 * kiln_sky_cells_release, also after an error. */
int kiln_sky_cells_create(struct kiln_sky_cells *cells, const struct kiln_lights *lights, size_t most,
                          struct kiln_error *error);
void kiln_sky_cells_release(struct kiln_sky_cells *cells);

/* Draws a direction (outwards) from u and v in (0, 1); *density: per steradian, within the cell. */
struct kiln_dvec3 kiln_sky_cell_sample(const struct kiln_sky_cells *cells, size_t cell, double u, double v,
                                       double *density);
/* The cell of a direction, outwards. */
size_t kiln_sky_cell_of(const struct kiln_sky_cells *cells, struct kiln_dvec3 direction);

#endif
