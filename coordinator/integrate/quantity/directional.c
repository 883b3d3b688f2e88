/* Directional distribution of light (worker/pass/directional.h): the field `sh`, or `dominant`, which is derived from
 * it. */
#include <math.h>
#include <string.h>

#include "coordinator/field/rank_data.h"
#include "coordinator/integrate/quantity.h"
#include "worker/base/color.h"
#include "worker/pass/directional.h"

static bool wanted(const struct kiln_integrate_settings *settings)
{
    return settings->directional != KILN_DIRECTIONAL_NONE;
}

static void make_step(const struct kiln_integrate_settings *settings, struct kiln_step *step)
{
    step->pass = &kiln_pass_directional;
    step->samples = settings->samples_quantity;
}

/* Computes the dominant direction of light, and how directed the light is: 0 for light from everywhere, 1 from a single
 * direction. For the latter the length of band 1 is sqrt(3) times band 0. */
static void set_dominant(float dominant[4], const float harmonics[KILN_DIRECTIONAL_HARMONICS][3])
{
    const double zero = kiln_luminance_of_floats(harmonics[0]);
    const double axis[3] = {kiln_luminance_of_floats(harmonics[3]), kiln_luminance_of_floats(harmonics[1]),
                            kiln_luminance_of_floats(harmonics[2])};
    const double length = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    for (int c = 0; c < 3; c++)
        dominant[c] = length > 0.0 ? (float)(axis[c] / length) : 0.0f;
    dominant[3] = zero > 0.0 ? (float)fmin(1.0, length / (sqrt(3.0) * zero)) : 0.0f;
}

static void take(const struct kiln_taking *t, const struct kiln_rank_data *data, const struct kiln_tile_run *tile_run,
                 const void *answers)
{
    const struct kiln_directional_result *results = answers;
    const bool dominant = t->settings->directional == KILN_DIRECTIONAL_DOMINANT;
    const size_t field = kiln_field_set_find(t->fields, dominant ? "dominant" : "sh");
    float *values = kiln_rank_field(data, t->fields, field);
    const uint64_t first = kiln_own_of_global(&data->surface, tile_run->first).at;
    for (uint64_t i = 0; i < tile_run->count; i++) {
        float harmonics[KILN_DIRECTIONAL_HARMONICS][3];
        for (int h = 0; h < KILN_DIRECTIONAL_HARMONICS; h++)
            for (int c = 0; c < 3; c++)
                harmonics[h][c] = kiln_mean(results[i].radiance[h][c], results[i].count);
        if (dominant)
            set_dominant(&values[4 * (first + i)], harmonics);
        else
            memcpy(&values[12 * (first + i)], harmonics, sizeof harmonics);
    }
}

const struct kiln_quantity kiln_quantity_directional = {.role = {.kind = "directional",
                                                                 .total = "directional",
                                                                 .title = "light by direction",
                                                                 .phase = "light by direction"},
                                                        .wanted = wanted,
                                                        .make_step = make_step,
                                                        .take = take};
