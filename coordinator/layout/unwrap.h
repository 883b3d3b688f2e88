/* Unwrapping: makes a lightmap layout for a mesh that has no usable second UV set. */
#ifndef KILN_COORDINATOR_LAYOUT_UNWRAP_H
#define KILN_COORDINATOR_LAYOUT_UNWRAP_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/arena.h"
#include "worker/base/status.h"
#include "worker/base/vector.h"

struct kiln_unwrap_params {
    double linear[9]; /* row-major: maps mesh space to the space in which areas are measured */
    /* desired density in that space; with `size` only an estimate, for the resolution of the overlap test */
    double texels_per_metre;
    uint32_t padding; /* texels */
    uint32_t size;    /* the lightmap is size x size texels; 0: as large as the density needs */
    uint32_t max;     /* largest side, texels */
};

/* The new layout. A vertex where several charts meet has one copy for each chart. */
struct kiln_unwrapped {
    size_t vertex_count;
    uint32_t *source;     /* per vertex: the old vertex that it copies */
    struct kiln_vec2 *uv; /* per vertex: inside 0..1 */
    size_t capacity, uv_capacity;
    uint32_t *triangles; /* 3 per triangle, in the old order */
    size_t chart_count, degenerate_count;
    uint32_t width, height;  /* texels of the lightmap for which it was packed */
    double texels_per_metre; /* the density reached */
    uint32_t cells;          /* more than 1: charts share texels, see struct kiln_packing */
    struct kiln_arena arena;
};

/* Unwraps a mesh. A degenerate triangle gets a point of a neighbour's chart and no area. Old vertices that no triangle
 * uses are left out. Deterministic. Destroy with kiln_unwrapped_destroy. */
int kiln_unwrap(struct kiln_unwrapped **unwrapped, const struct kiln_vec3 *positions, size_t vertex_count,
                const uint32_t *triangles, size_t triangle_count, const struct kiln_unwrap_params *params,
                struct kiln_error *error);
/* Repacks a mesh that has a layout: its charts (found by kiln_padding_charts) keep their shapes, relative sizes and
 * orientation, and are packed anew; a rectangle may be stretched as kiln_pack says. `metres`: what a unit of u and of v
 * spans in the space in which areas are measured; params->linear is not used. Triangles without area in the layout are
 * treated as degenerate ones are by kiln_unwrap. */
int kiln_repack(struct kiln_unwrapped **unwrapped, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv,
                size_t vertex_count, const uint32_t *triangles, size_t triangle_count, const double metres[2],
                const struct kiln_unwrap_params *params, struct kiln_error *error);

void kiln_unwrapped_destroy(struct kiln_unwrapped **unwrapped);

#endif
