/* Radiance probes: a grid of places in space that store the radiance of surfaces from all directions, for gather rays
 * that end at a range (Vandersanden, "Radiance Cells", 2023, chapters 3.6 and 3.7). Format and lookup of a probe are in
 * shaders/shared/radiance_probe.h, for C and GLSL. */
#ifndef KILN_WORKER_SCENE_RADIANCE_PROBES_H
#define KILN_WORKER_SCENE_RADIANCE_PROBES_H

#include <stddef.h>
#include <stdint.h>

#include "shaders/shared/radiance_probe.h"
#include "worker/base/vector.h"

_Static_assert(sizeof(struct kiln_probe_grid) == 18 * 4, "shaders and C agree on struct kiln_probe_grid");

/* Largest number of probes: a point's word (near_probes) has 24 bits for a probe. */
#define KILN_PROBES_MOST ((uint64_t)1 << 24)

/* Radiance probes of a scene; a backend borrows this struct. */
struct kiln_radiance_probes {
    struct kiln_probe_grid grid;
    const struct kiln_vec3 *positions; /* position of each probe, m from the centre; may differ from the grid. x =
                                        * KILN_PROBE_OFF: the probe is off, without radiance */
    const float *data;                 /* grid.floats a probe, W/(m2 sr): RGB of each coefficient or element */
};

static inline uint64_t kiln_probes_count(const struct kiln_probe_grid *grid)
{
    return (uint64_t)grid->size[0] * grid->size[1] * grid->size[2];
}

/* Probe at a corner of a cell; `cell`: the probe at the cell's first corner. */
static inline uint32_t kiln_probe_at_corner(const struct kiln_probe_grid *grid, uint32_t cell, uint32_t corner)
{
    return cell + (corner & 1u) + ((corner >> 1 & 1u) + (corner >> 2 & 1u) * grid->size[1]) * grid->size[0];
}

/* Cell that contains a place, or the nearest cell for places outside of the grid, as the number of its first corner's
 * probe. */
uint32_t kiln_probe_cell(const struct kiln_probe_grid *grid, struct kiln_vec3 at);
/* Draws one of the cell's corners in the bit mask `corners`, which is not 0, by trilinear weights at the place; u:
 * random, in (0, 1). Returns the number of the corner's probe. */
uint32_t kiln_probe_draw(const struct kiln_probe_grid *grid, uint32_t cell, uint32_t corners, struct kiln_vec3 at,
                         float u);
/* Looks up the probe's radiance for a ray from `at` with unit direction d, which leaves the scene's box at distance
 * `far` (kiln_probe_far). With harmonics it may be negative. */
void kiln_probe_ask(const struct kiln_radiance_probes *probes, uint32_t probe, struct kiln_vec3 at, struct kiln_vec3 d,
                    float far, float radiance[3]);

static inline bool kiln_probe_is_off(const struct kiln_radiance_probes *probes, uint32_t probe)
{
    return probes->positions[probe].x >= KILN_PROBE_OFF;
}

#endif
