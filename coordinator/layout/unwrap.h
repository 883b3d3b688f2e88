/* A mesh without a usable second UV set gets a lightmap layout of its own. */
#ifndef KILN_COORDINATOR_LAYOUT_UNWRAP_H
#define KILN_COORDINATOR_LAYOUT_UNWRAP_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

struct kiln_unwrap_params {
    double linear[9];        /* row-major: mesh space to the space whose areas count */
    double texels_per_metre; /* wanted there; with `size` only a guess that sets how finely charts are tested */
    uint32_t padding;        /* texels */
    uint32_t size;           /* the lightmap is size x size; 0: as large as the density asks */
    uint32_t max;            /* largest side */
};

/* Vertices of the new layout: where charts meet a vertex is there once for each of them. */
struct kiln_unwrapped {
    size_t vertex_count;
    uint32_t *source;     /* a vertex: which one of the old vertices it copies */
    struct kiln_vec2 *uv; /* a vertex: inside 0..1 */
    size_t capacity, uv_capacity;
    uint32_t *triangles; /* 3 a triangle, in the old order */
    size_t chart_count, degenerate_count;
    uint32_t width, height;  /* lightmap for which it was packed */
    double texels_per_metre; /* what the density came to */
    uint32_t cells;          /* more than 1: charts share texels, see struct kiln_packing */
};

/* Degenerate triangles get a point of a neighbour's chart, and no area. Old vertices that no triangle uses are left
 * out. Deterministic. Destroy with kiln_unwrapped_destroy. */
int kiln_unwrap(struct kiln_unwrapped **unwrapped, const struct kiln_vec3 *positions, size_t vertex_count,
                const uint32_t *triangles, size_t triangle_count, const struct kiln_unwrap_params *params,
                struct kiln_error *error);
/* The same for a mesh that has a layout: its charts (as kiln_padding_charts finds them) keep shape, size against each
 * other, and sense, and are packed anew; a rectangle may be stretched as kiln_pack says. `metres`: a unit of u and of v
 * in the space whose areas count; `linear` in `params` is not read. Triangles without area in the layout are what
 * degenerate ones are to kiln_unwrap. */
int kiln_repack(struct kiln_unwrapped **unwrapped, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv,
                size_t vertex_count, const uint32_t *triangles, size_t triangle_count, const double metres[2],
                const struct kiln_unwrap_params *params, struct kiln_error *error);

void kiln_unwrapped_destroy(struct kiln_unwrapped **unwrapped);

#endif
