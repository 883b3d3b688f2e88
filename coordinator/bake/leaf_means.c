#include "coordinator/bake/leaf_means.h"

#include <math.h>

#include "coordinator/integrate/energy.h"
#include "coordinator/job/job.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

/* Sums over an object's leaves: number of all and of valid leaves; m2 of all and of valid leaves; W; W2/m2; W of each
 * part of the bake. */
enum { LEAVES, VALID, ALL_AREA, AREA, LIGHT, VARIANCE, PARTS, SUMS = PARTS + KILN_PARTS };

struct means {
    const struct kiln_bake_result *result;
    /* indices of fields; the number of fields stands for a field that the bake does not have */
    size_t total, error, parts;
    double unit[SUMS]; /* steps of the sums */
    struct kiln_exact_sum (*sums)[SUMS];
};

static void add(const struct means *m, size_t object, int sum, double value)
{
    kiln_exact_add(&m->sums[object][sum], value, 1.0 / m->unit[sum]);
}

static void add_leaf(const struct means *m, size_t object, struct kiln_own_point point)
{
    const struct kiln_bake_result *r = m->result;
    const double area = (double)r->surface->area[point.at];
    float values[KILN_FIELD_COMPONENTS_MAX];
    double rgb[3];
    add(m, object, LEAVES, 1.0);
    add(m, object, ALL_AREA, area);
    if (!kiln_point_valid(r->surface, point))
        return;
    add(m, object, VALID, 1.0);
    add(m, object, AREA, area);
    kiln_rank_floats(r->data, r->fields, m->total, point, values);
    for (int c = 0; c < 3; c++)
        rgb[c] = (double)values[c];
    add(m, object, LIGHT, area * kiln_luminance(rgb));
    kiln_rank_floats(r->data, r->fields, m->error, point, values);
    add(m, object, VARIANCE, area * (double)values[0] * (double)values[0]);
    if (m->parts == r->fields->count)
        return;
    kiln_rank_floats(r->data, r->fields, m->parts, point, values);
    for (int k = 0; k < KILN_PARTS; k++)
        add(m, object, PARTS + k, area * (double)values[k]);
}

static void add_own(const struct means *m)
{
    const struct kiln_surface *s = m->result->surface;
    for (size_t i = 0; i < s->tile_run_count; i++) {
        const struct kiln_tile_run *run = &s->tile_runs[i];
        const uint64_t first = run->first.at - s->first.at;
        for (uint64_t k = first; k < first + run->count && !kiln_map_back(s, run->map); k++)
            add_leaf(m, kiln_map_object(s, run->map), (struct kiln_own_point){k});
    }
}

static double value_of(const struct means *m, size_t object, int sum)
{
    return kiln_exact_value(&m->sums[object][sum], m->unit[sum]);
}

/* Relative standard error of the object's mean, estimated from the spread of the parts. */
static double error_of_mean(const struct means *m, size_t object)
{
    double mean = 0.0, square = 0.0;
    for (int k = 0; k < KILN_PARTS; k++)
        mean += value_of(m, object, PARTS + k) / KILN_PARTS;
    for (int k = 0; k < KILN_PARTS; k++) {
        const double off = value_of(m, object, PARTS + k) - mean;
        square += off * off;
    }
    return mean > 0.0 ? KILN_PARTS_STUDENT * sqrt(square / (KILN_PARTS * (KILN_PARTS - 1))) / mean : 0.0;
}

static void report(const struct means *m, size_t object, struct kiln_lightmap_report *report)
{
    const double all = value_of(m, object, ALL_AREA), area = value_of(m, object, AREA);
    report->valid = (uint64_t)value_of(m, object, VALID);
    report->texels_per_metre = all > 0.0 ? sqrt(value_of(m, object, LEAVES) / all) : 0.0;
    report->mean = area > 0.0 ? value_of(m, object, LIGHT) / area : 0.0;
    report->error = report->mean > 0.0 ? sqrt(value_of(m, object, VARIANCE) / area) / report->mean : 0.0;
    report->mean_error = error_of_mean(m, object);
}

int kiln_leaf_means(struct kiln_lightmap_report *reports, const struct kiln_bake_result *result, double power,
                    struct kiln_error *error)
{
    const size_t objects = result->scene->object_count;
    const double area = kiln_exact_unit(1.0), light = kiln_exact_unit(power);
    struct means m = {.result = result,
                      .total = kiln_field_set_find(result->fields, "total"),
                      .error = kiln_field_set_find(result->fields, "error"),
                      .parts = kiln_field_set_find(result->fields, "parts"),
                      .unit = {1.0, 1.0, area, area, light, kiln_exact_unit(power * power)}};
    for (int k = 0; k < KILN_PARTS; k++)
        m.unit[PARTS + k] = light;
    int status;
    KILN_TRY(kiln_agree(result->communicator, kiln_allocate(&m.sums, objects, sizeof *m.sums, "objects' means", error),
                        error));
    add_own(&m);
    KILN_TRY(kiln_exact_reduce(result->communicator, &m.sums[0][0], SUMS * objects, error));
    for (size_t i = 0; i < objects; i++)
        report(&m, i, &reports[i]);
end:
    kiln_free(&m.sums);
    return status;
}
