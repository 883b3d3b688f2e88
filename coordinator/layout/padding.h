/* Measures how far apart the charts of a layout lie.
 *
 * Bilinear filtering reads texels up to one texel away, along each axis, from a position on a chart. So two charts
 * never read the same texel if their distance (the larger of the distances along u and v) is at least two texels,
 * wherever on the grid they lie. If it is less, light may bleed from one chart to the other. A larger lightmap helps:
 * twice the sides, twice the distance. */
#ifndef KILN_COORDINATOR_LAYOUT_PADDING_H
#define KILN_COORDINATOR_LAYOUT_PADDING_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

enum { KILN_PADDING_STEPS = 48, KILN_PADDING_OCTAVE = 8 };
#define KILN_PADDING_TEXELS 2.0

/* The measurement of one layout at one lightmap size. Lengths are in texels of that lightmap. */
struct kiln_padding {
    size_t charts, close_charts; /* close: nearer than two texels to another chart somewhere */
    double border;               /* length of the borders of all charts */
    double close;                /* length of border that is nearer than two texels to another chart */
    /* `close`, by the factor on the lightmap's sides that would make the distance two texels: entry k counts factors
     * from 2^(k / 8) to 2^((k + 1) / 8). Border that needs a factor above 64 is not counted: such charts touch. */
    double by_factor[KILN_PADDING_STEPS];
};

/* Measures a layout in a lightmap of width x height texels, which need not be whole numbers. A chart is a set of
 * triangles connected through edges whose ends have equal positions and equal coordinates. Time grows with the number
 * of triangles and the texels of border. Deterministic. KILN_SYSTEM. */
int kiln_padding_measure(struct kiln_padding *padding, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv,
                         size_t vertex_count, const uint32_t *triangles, size_t triangle_count, double width,
                         double height, struct kiln_error *error);

/* Adds `padding` to `sum`. */
void kiln_padding_add(struct kiln_padding *sum, const struct kiln_padding *padding);

/* The least factor on the lightmap's sides, at least 1, after which at most the fraction `fraction` of the border is
 * close; INFINITY if none is enough. */
double kiln_padding_factor(const struct kiln_padding *padding, double fraction);

/* Finds the chart of each triangle, and whether edge k of a triangle is a border of its chart (bit k of `borders`).
 * Charts are connected as for kiln_padding_measure and numbered by their first triangle. `chart` and `borders` have one
 * entry per triangle. */
int kiln_padding_charts(const struct kiln_vec3 *positions, const struct kiln_vec2 *uv, size_t vertex_count,
                        const uint32_t *triangles, size_t triangle_count, uint32_t *chart, uint8_t *borders,
                        size_t *chart_count, struct kiln_error *error);

#endif
