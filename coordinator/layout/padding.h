/* How far apart the charts of a layout lie.
 *
 * Bilinear filtering reads a texel up to one texel away, along each axis, from a place on a chart; so two charts never
 * read the same texel where their distance (the larger of the two along u and v) is two texels or more, wherever on the
 * grid they lie. Where it is less, light may bleed from one to the other. A larger lightmap helps: twice the sides,
 * twice the distance. */
#ifndef KILN_COORDINATOR_LAYOUT_PADDING_H
#define KILN_COORDINATOR_LAYOUT_PADDING_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

enum { KILN_PADDING_STEPS = 48, KILN_PADDING_OCTAVE = 8 };
#define KILN_PADDING_TEXELS 2.0

/* Lengths in texels of the lightmap that was measured for. */
struct kiln_padding {
    size_t charts, close_charts; /* close: nearer than two texels to another one somewhere */
    double border;               /* of all charts */
    double close;                /* of it, nearer than two texels to another chart */
    /* of `close`, by the factor on the lightmap's sides that makes two texels of it: entry k from 2^(k / 8) to 2^((k +
     * 1) / 8). What needs more than 64 is not here: such charts touch. */
    double by_factor[KILN_PADDING_STEPS];
};

/* Measures a layout in a lightmap of width x height texels (which need not be whole). Charts hang together by triangle
 * edges whose ends have equal positions and equal coordinates. Time grows with triangles and with texels of border.
 * Deterministic. KILN_SYSTEM. */
int kiln_padding_measure(struct kiln_padding *padding, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv,
                         size_t vertex_count, const uint32_t *triangles, size_t triangle_count, double width,
                         double height, struct kiln_error *error);

/* sum += padding */
void kiln_padding_add(struct kiln_padding *sum, const struct kiln_padding *padding);

/* The least factor on the lightmap's sides, at least 1, after which at most `share` of the border is close; INFINITY
 * where none is enough. */
double kiln_padding_factor(const struct kiln_padding *padding, double share);

/* The chart of each triangle and whether edge k of a triangle is a border (bit k), for which the charts are as said
 * above. `chart` and `borders` have an entry a triangle. Charts are numbered by their first triangle. */
int kiln_padding_charts(const struct kiln_vec3 *positions, const struct kiln_vec2 *uv, size_t vertex_count,
                        const uint32_t *triangles, size_t triangle_count, uint32_t *chart, uint8_t *borders,
                        size_t *chart_count, struct kiln_error *error);

#endif
