/* Whether a mesh's second UV set can serve as its lightmap layout. */
#ifndef KILN_COORDINATOR_LAYOUT_UV_CHECK_H
#define KILN_COORDINATOR_LAYOUT_UV_CHECK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

struct kiln_uv_verdict {
    bool valid;
    double overlap;    /* share of covered samples that more than one triangle claims */
    double uv_area;    /* share of the unit square */
    char reason[192];  /* why it is not valid; continues "its second UV set ..." */
    char warning[192]; /* valid, but not quite clean; empty otherwise */
};

/* A set is valid when every coordinate in use is finite and within 1e-4 of 0..1; triangles that have shrunk to less
 * than 1e-4 of the mesh's mean density hold at most 0.5 % of its area (a warning from 0.1 %); at most 3 % of its
 * samples (2048 a side; 4096 from 20,000 triangles on) are claimed twice (a warning from 0.5 %: usual packers give up
 * to 0.4 % by rounding at the seams, and up to 3 % where the layout was made for a few texels); and it uses at least
 * 1/256 of the square, since a lightmap is as large as the square. */
int kiln_uv_check(struct kiln_uv_verdict *verdict, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv,
                  const uint32_t *triangles, size_t triangle_count, struct kiln_error *error);

#endif
