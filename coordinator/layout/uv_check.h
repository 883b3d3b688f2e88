/* The test whether a mesh's second UV set can serve as its lightmap layout. */
#ifndef KILN_COORDINATOR_LAYOUT_UV_CHECK_H
#define KILN_COORDINATOR_LAYOUT_UV_CHECK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

struct kiln_uv_verdict {
    bool valid;
    double overlap;    /* fraction of the covered samples that more than one triangle covers */
    double uv_area;    /* fraction of the unit square */
    char reason[192];  /* why it is not valid; continues "its second UV set ..." */
    char warning[192]; /* valid, but with a flaw; empty otherwise. Continues the same sentence */
};

/* Checks a UV set. It is valid if all of these hold:
 * - Every coordinate in use is finite and within 1e-4 of 0..1.
 * - Triangles that have shrunk to less than 1e-4 of the mesh's mean density hold at most 0.5 % of its area (a warning
 *   from 0.1 %).
 * - At most 3 % of the covered samples are covered twice (a warning from 0.5 %). Common packers give up to 0.4 % by
 *   rounding at the seams, and up to 3 % where the layout was made for a few texels. There are 2048 samples a side;
 *   4096 from 20,000 triangles on.
 * - It uses at least 1/256 of the square, since a lightmap is as large as the square. */
int kiln_uv_check(struct kiln_uv_verdict *verdict, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv,
                  const uint32_t *triangles, size_t triangle_count, struct kiln_error *error);

#endif
