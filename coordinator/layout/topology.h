/* The topology of a mesh for unwrapping: welded positions; triangles with normals, areas and neighbours. */
#ifndef KILN_COORDINATOR_LAYOUT_TOPOLOGY_H
#define KILN_COORDINATOR_LAYOUT_TOPOLOGY_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/arena.h"
#include "worker/base/status.h"
#include "worker/base/vector.h"
#include "worker/scene/scene.h"

struct kiln_topology {
    size_t vertex_count, triangle_count;
    const uint32_t *triangles; /* borrowed; 3 per triangle */
    /* per vertex: m, in the reference object's own space, relative to the mesh's middle */
    struct kiln_dvec3 *points;
    struct kiln_dvec3 *normals; /* per triangle: unit; zero if degenerate */
    double *areas;              /* per triangle: m2; 0 if degenerate */
    uint32_t *neighbours;       /* 3 per triangle: the triangle across edge k (corner k to k+1), or KILN_NONE */
    size_t degenerate_count;
    struct kiln_arena arena;
};

/* Builds the topology. `linear` (row-major 3 x 3) maps mesh space to the space in which areas and angles are measured.
 * Vertices with the same coordinates are one. Two triangles are neighbours if they traverse an edge in opposite
 * directions. Where more than two share an edge, those whose normals agree best are paired; an edge of more than 8
 * triangles joins none. A triangle is degenerate if its height is below 1e-7 of its longest edge. The triangles are
 * borrowed. Destroy with kiln_topology_destroy. */
int kiln_topology_create(struct kiln_topology **topology, const struct kiln_vec3 *positions, size_t vertex_count,
                         const uint32_t *triangles, size_t triangle_count, const double linear[9],
                         struct kiln_error *error);
void kiln_topology_destroy(struct kiln_topology **topology);

/* A 64-bit hash for the hash tables of this directory. */
static inline uint64_t kiln_layout_mix(uint64_t x)
{
    x ^= x >> 32;
    x *= 0xd6e8feb86659fd93u;
    x ^= x >> 32;
    x *= 0xd6e8feb86659fd93u;
    return x ^ x >> 32;
}

/* The least power of two of which `count` entries fill at most half. */
static inline size_t kiln_layout_table_size(size_t count)
{
    size_t size = 16;
    while (size < 2 * count)
        size *= 2;
    return size;
}

#endif
