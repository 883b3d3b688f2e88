/* Ambient occlusion and the bent normal (worker/pass/occlusion.h): the fields ambient_occlusion and bent_normal. */
#include <math.h>

#include "coordinator/field/rank_data.h"
#include "coordinator/integrate/quantity.h"
#include "worker/pass/occlusion.h"

static bool wanted(const struct kiln_integrate_settings *settings) { return settings->occlusion != NULL; }

static void make_step(const struct kiln_integrate_settings *settings, struct kiln_step *step)
{
    step->pass = &kiln_pass_occlusion;
    step->parameters = settings->occlusion;
    step->samples = settings->samples_quantity;
}

static void *values_of(const struct kiln_taking *t, const struct kiln_rank_data *data, const char *field)
{
    return kiln_rank_field(data, t->fields, kiln_field_set_find(t->fields, field));
}

/* Normalizes a direction, which may be a sum instead of a mean. Without any open direction it is 0. */
static void set_unit(float unit[3], const float direction[3])
{
    const double x = (double)direction[0], y = (double)direction[1], z = (double)direction[2];
    const double length = sqrt(x * x + y * y + z * z);
    for (int c = 0; c < 3; c++)
        unit[c] = length > 0.0 ? (float)((double)direction[c] / length) : 0.0f;
}

static void take(const struct kiln_taking *t, const struct kiln_rank_data *data, const struct kiln_tile_run *tile_run,
                 const void *answers)
{
    const struct kiln_occlusion_result *results = answers;
    const uint64_t first = kiln_own_of_global(&data->surface, tile_run->first).at;
    uint16_t *open = values_of(t, data, "ambient_occlusion");
    float *bent_normal = values_of(t, data, "bent_normal");
    for (uint64_t i = 0; i < tile_run->count; i++) {
        open[first + i] = (uint16_t)lrintf(kiln_mean(results[i].open, results[i].count) * 65535.0f);
        set_unit(&bent_normal[3 * (first + i)], results[i].direction);
    }
}

const struct kiln_quantity kiln_quantity_occlusion = {.role = {.kind = "ambient occlusion",
                                                               .total = "ambient_occlusion",
                                                               .title = "ambient occlusion",
                                                               .phase = "ambient occlusion"},
                                                      .wanted = wanted,
                                                      .make_step = make_step,
                                                      .take = take};
