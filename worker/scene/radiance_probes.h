/* Radiance probes: a grid of places in space at which the radiance that surfaces send is known from all directions, for
 * gather rays that end at a range (Vandersanden, "Radiance Cells", 2023, chapters 3.6 and 3.7). What a probe keeps and
 * how it is asked stands in shaders/shared/radiance_probe.h, for C and GLSL. */
#ifndef KILN_WORKER_SCENE_RADIANCE_PROBES_H
#define KILN_WORKER_SCENE_RADIANCE_PROBES_H

#include <stddef.h>
#include <stdint.h>

#include "shaders/shared/radiance_probe.h"
#include "worker/base/vector.h"

_Static_assert(sizeof(struct kiln_probe_grid) == 18 * 4, "shaders and C agree on struct kiln_probe_grid");

/* Probes are named by 24 bits in a point's word. */
#define KILN_PROBES_MOST ((uint64_t)1 << 24)

/* Borrowed by a backend that has it. */
struct kiln_radiance_probes {
    struct kiln_probe_grid grid;
    const struct kiln_vec3 *positions; /* of each probe, which may have been moved off the grid, m from the
                                        * centre; with x = KILN_PROBE_OFF it is off: it has no radiance */
    const float *data;                 /* grid.floats a probe, W/(m2 sr): RGB of each coefficient or element */
};

static inline uint64_t kiln_probes_count(const struct kiln_probe_grid *grid)
{
    return (uint64_t)grid->size[0] * grid->size[1] * grid->size[2];
}

/* The probe at corner `corner` of the cell whose first corner is the probe `cell`. */
static inline uint32_t kiln_probe_at_corner(const struct kiln_probe_grid *grid, uint32_t cell, uint32_t corner)
{
    return cell + (corner & 1u) + ((corner >> 1 & 1u) + (corner >> 2 & 1u) * grid->size[1]) * grid->size[0];
}

/* The cell that a place lies in, by the number of its first corner; of the nearest one outside of the grid. */
uint32_t kiln_probe_cell(const struct kiln_probe_grid *grid, struct kiln_vec3 at);
/* One of the corners of the cell that `corners` names, one at least, by its trilinear weights at the place and a random
 * number u in (0, 1): the number of its probe. */
uint32_t kiln_probe_draw(const struct kiln_probe_grid *grid, uint32_t cell, uint32_t corners, struct kiln_vec3 at,
                         float u);
/* Radiance that the probe has for a ray from `at` with direction d, of unit length, that leaves the scene's box at the
 * distance `far` (kiln_probe_far). Harmonics may give less than 0. */
void kiln_probe_ask(const struct kiln_radiance_probes *probes, uint32_t probe, struct kiln_vec3 at, struct kiln_vec3 d,
                    float far, float radiance[3]);

static inline bool kiln_probe_is_off(const struct kiln_radiance_probes *probes, uint32_t probe)
{
    return probes->positions[probe].x >= KILN_PROBE_OFF;
}

#endif
