/* Light by group of lights (worker/light/light_groups.h). The direct and gather passes compute it with the same rays as
 * the total light: a shadow ray's light is added to the group of its light, and a gather ray reads the radiosity of
 * each group beside the total. So the groups of a point add up to its light, but for the rounding of sums and
 * radiosity. The probe pass does the same at places in space.
 *
 * Gather rays must end at their first hit: groups work without radiance probes, gloss and tinted surfaces only. */
#ifndef KILN_WORKER_PASS_GROUPS_H
#define KILN_WORKER_PASS_GROUPS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct kiln_light_groups;

/* Floats of a group's answer at a surface point: incident light RGB and irradiance RGB, sums as in struct
 * kiln_point_result. */
enum { KILN_GROUP_FLOATS = 6 };
/* Floats of a group's answer at a probe: coefficients of radiance, then irradiance along the axes, as in struct
 * kiln_probe_result. */
enum { KILN_GROUP_PROBE_FLOATS = 27 + 18 };

/* Groups of lights, as a backend is given them (kiln_backend_set_groups). */
struct kiln_groups {
    const struct kiln_light_groups *lights; /* borrowed */
    const uint64_t *radiosity;              /* packed, of all surface points: `lights->count` for each; borrowed */
    bool changed; /* the radiosity has changed since the backend last read it; reading sets false */
    /* Answers for the current part of a batch, filled in by the backend: `lights->count` for each surface point or
     * probe. `first`: the first point in the global order, or the first probe. Release `answers` with kiln_free. */
    uint64_t first;
    float *answers;
    size_t room; /* floats */
};

#endif
