/* The grid of radiance probes, and the conversion of a probe's ray results into its data. */
#ifndef KILN_COORDINATOR_INTEGRATE_PROBES_RADIANCE_GRID_H
#define KILN_COORDINATOR_INTEGRATE_PROBES_RADIANCE_GRID_H

#include "coordinator/job/choices.h"
#include "worker/sampling/harmonics.h"
#include "worker/pass/radiance.h"
#include "worker/scene/geometry.h"
#include "worker/scene/radiance_probes.h"

/* Makes the grid over the scene's bounding box: boxes as wide as the spacing, a probe in the middle of each, so that
 * none lies in a wall at the scene's bounds. KILN_USAGE for more than KILN_PROBES_MOST probes. Not collective, no side
 * effects. */
int kiln_probe_grid_make(struct kiln_probe_grid *grid, const struct kiln_radiance_settings *settings,
                         const struct kiln_geometry *geometry, struct kiln_error *error);

/* Rays per map element of each probe. */
uint32_t kiln_probe_element_samples(const struct kiln_probe_grid *grid, const struct kiln_radiance_settings *settings);

/* Position of a probe in the grid, m from the scene's centre. */
struct kiln_vec3 kiln_probe_grid_position(const struct kiln_probe_grid *grid, uint64_t probe);

/* Weights of a map's element: its solid angle, sr, and the integrals of the harmonics over it. Over all elements they
 * sum to 4 pi, and to 2 sqrt(pi), 0, 0, ...: for a map of constant radiance all other harmonics vanish. */
struct kiln_probe_element {
    double solid_angle, harmonics[KILN_HARMONICS];
};
/* Fills in all elements of the grid's map. */
void kiln_probe_elements_make(const struct kiln_probe_grid *grid, struct kiln_probe_element *elements);

/* Fraction of all directions in which rays meet backs of surfaces. */
double kiln_probe_back_share(const struct kiln_probe_element *elements, const struct kiln_radiance_result *results,
                             uint32_t count);
/* Writes the probe's data, grid->floats floats: its map, or the map's harmonics of bands 0 to 2. */
void kiln_probe_keep(const struct kiln_probe_grid *grid, const struct kiln_probe_element *elements,
                     const struct kiln_radiance_result *results, float *data);

#endif
