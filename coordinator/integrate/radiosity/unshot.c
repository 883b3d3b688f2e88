#include "coordinator/integrate/radiosity/unshot.h"

#include <string.h>

#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/cells/cells.h"
#include "coordinator/integrate/cells/schedule.h"
#include "coordinator/integrate/cells/take.h"
#include "coordinator/integrate/packing.h"
#include "coordinator/integrate/run/radiosity_exchange.h"
#include "coordinator/integrate/patches/senders.h"
#include "worker/scene/radiosity.h"

/* Sums the power that all steps reflect, and its sent part, W. */
static void add_up(const struct kiln_step_report *reports, size_t count, double *reflected, double *sent)
{
    *reflected = *sent = 0.0;
    for (size_t i = 0; i < count; i++) {
        *reflected += kiln_luminance(reports[i].energy.reflected);
        *sent += kiln_luminance(reports[i].energy.sent);
    }
}

double kiln_unshot_share(const struct kiln_step_report *reports, size_t count)
{
    double reflected, sent;
    add_up(reports, count, &reflected, &sent);
    return reflected > 0.0 ? (reflected - sent) / reflected : 0.0;
}

bool kiln_unshot_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                      size_t count, size_t before, struct kiln_step *step)
{
    const size_t rounds = count - before;
    const uint32_t passed = reports[before - 1].step.bounce,
                   bounce = passed + (uint32_t)(rounds / KILN_UNSHOT_ROUNDS) + 1;
    double reflected, sent;
    *step = (struct kiln_step){.pass = &kiln_pass_patches,
                               .role = KILN_RADIOSITY_ROUND,
                               .bounce = bounce,
                               .samples = settings->samples_indirect,
                               .stream = (uint32_t)rounds + 2,
                               .counted = true,
                               .with = KILN_WITH(senders)};
    if ((int64_t)bounce > (settings->bounces >= 0 ? settings->bounces : KILN_BOUNCES_ALL))
        return false;
    add_up(reports, count, &reflected, &sent);
    if (!(reflected > 0.0)) /* unknown, or a scene without light */
        return settings->bounces >= 0;
    return reflected - sent > settings->patches->unshot_left * reflected;
}

int kiln_unshot_begin(struct kiln_integration *in, struct kiln_step_report *last, const struct kiln_step *step)
{
    const struct kiln_rank_data *own = in->solution->own;
    if (last->step.role == KILN_CELLS_CAUSTIC) /* from now on the sum is of irradiance, and of rounds only */
        memset(own->sum, 0, 3 * own->surface.count * sizeof *own->sum);
    in->solution->report.bounces = step->bounce;
    kiln_exchange_radiosity(in->exchange, KILN_EXCHANGE_NEXT, last);
    return KILN_OK;
}

/* Splits a point's unshot radiosity: all of it is sent in the round, or all is kept. */
static void part(const struct kiln_taking *t, uint64_t point, float sent[3], float kept[3])
{
    const struct kiln_patches_parameters *p = t->step->parameters;
    const bool sends = (p->shot[point / 64] >> point % 64 & 1u) != 0;
    memset(sent, 0, 3 * sizeof *sent);
    memset(kept, 0, 3 * sizeof *kept);
    kiln_radiosity_unpack(t->radiosity[point], sends ? sent : kept);
}

static void enter(const struct kiln_rank_data *data, struct kiln_own_point own, const struct kiln_point_mean *mean,
                  const float radiosity[3])
{
    for (uint64_t c = 0; c < 3; c++) {
        data->sum[3 * own.at + c] += mean->irradiance[c];
        if (data->radiosity != NULL)
            data->radiosity[3 * own.at + c] += radiosity[c];
    }
}

void kiln_unshot_take(const struct kiln_taking *t, const struct kiln_rank_data *data, const struct kiln_tile_run *f,
                      const struct kiln_point_result *results, struct kiln_tally *sums,
                      struct kiln_tile_run_tally *tile_run)
{
    const bool counts =
        (t->scene->objects[kiln_map_object(&data->surface, f->map)].flags & KILN_OBJECT_RECEIVER_ONLY) == 0;
    struct kiln_own_point own = kiln_own_of_global(&data->surface, f->first);
    for (uint64_t rest = f->mask; rest != 0; rest &= rest - 1, own.at++, results++) {
        const struct kiln_point_mean mean = kiln_point_mean(results);
        float albedo[3], sent[3], kept[3], radiosity[3];
        kiln_point_albedo(&data->surface, own, albedo);
        part(t, kiln_global_of_own(&data->surface, own).at, sent, kept);
        for (int c = 0; c < 3; c++)
            radiosity[c] = albedo[c] * mean.incident[c];
        if (counts)
            kiln_cells_tally(t, &data->surface, own, &mean, albedo, sent, sums, tile_run);
        enter(data, own, &mean, radiosity);
        for (int c = 0; c < 3; c++)
            kept[c] += radiosity[c];
        data->next[own.at] =
            kiln_radiosity_pack(kept, kiln_packing_hash(f, (uint32_t)__builtin_ctzll(rest), t->step->stream));
    }
}
