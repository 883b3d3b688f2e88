/* The light of each group of lights (worker/light/light_groups.h), which the passes of direct light and of gathers find
 * beside the light of all, with the same rays: a shadow ray's light counts for the group of the light that it was sent
 * to, and a gather ray reads the radiosity of each group where it reads that of all. So the groups of a point add up to
 * its light, but for how sums and radiosity are rounded. The probe pass does the same at places in space.
 *
 * Of gather rays that end at the first surface that they meet: without radiance probes, gloss and tinted surfaces. */
#ifndef KILN_WORKER_PASS_GROUPS_H
#define KILN_WORKER_PASS_GROUPS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct kiln_light_groups;

/* Floats of an answer: incident light RGB and irradiance RGB, sums as those of struct kiln_point_result. */
enum { KILN_GROUP_FLOATS = 6 };
/* Floats of an answer of the probe pass: coefficients of radiance, then irradiance along the axes, as struct
 * kiln_probe_result has them. */
enum { KILN_GROUP_PROBE_FLOATS = 27 + 18 };

/* Groups of lights, as a backend is given them (kiln_backend_set_groups). */
struct kiln_groups {
    const struct kiln_light_groups *lights; /* borrowed */
    const uint64_t *radiosity;              /* packed, of all surface points: `lights->count` for each; borrowed */
    bool changed; /* the radiosity is not what it was when the backend last read it, which sets this to false */
    /* Answers of the part of a batch that is being taken: its first surface point in the global order, or its first
     * probe, and `lights->count` answers for each from there on. The backend fills them in; release `answers` with
     * kiln_free. */
    uint64_t first;
    float *answers;
    size_t room; /* floats */
};

#endif
