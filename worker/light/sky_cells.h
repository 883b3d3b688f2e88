/* Cells of the sky: an image from outside, cut into directions from which light comes together, so that light paths are
 * shared out among them (worker/light/aims.h).
 *
 * A cell is a rectangle of the image's texels. First what is much brighter than the rest and small, a sun, is cut out
 * by four cuts; then the cell is cut whose light comes from the most different directions, where that leaves the least
 * of it: of a cell the luminance of its flux less the length of the sum of its flux times direction. Within a cell
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
    double *until; /* of each row of each cell: share of the cell up to its end */
};

/* At most `most` cells, at least one where there is an image. Borrows the lights. KILN_SYSTEM. Release with
 * kiln_sky_cells_release, also after an error. */
int kiln_sky_cells_create(struct kiln_sky_cells *cells, const struct kiln_lights *lights, size_t most,
                          struct kiln_error *error);
void kiln_sky_cells_release(struct kiln_sky_cells *cells);

/* Draws a direction, outwards, for u and v in (0, 1); its density per steradian within the cell. */
struct kiln_dvec3 kiln_sky_cell_sample(const struct kiln_sky_cells *cells, size_t cell, double u, double v,
                                       double *density);
/* The cell of a direction, outwards. */
size_t kiln_sky_cell_of(const struct kiln_sky_cells *cells, struct kiln_dvec3 direction);

#endif
