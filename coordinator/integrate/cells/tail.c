#include "coordinator/integrate/cells/tail.h"

#include <math.h>

#include "coordinator/field/radiosity_allgather.h"
#include "coordinator/integrate/cells/schedule.h"
#include "coordinator/integrate/parts.h"
#include "worker/scene/radiosity.h"

int kiln_tail_measure(const struct kiln_integration *in, const struct kiln_step_reports *reports, double *tail_error,
                      struct kiln_error *error)
{
    struct kiln_ledger *l = in->ledger;
    const size_t last = reports->count - 1;
    const double q =
        fmin(last > kiln_cells_first(in->settings) ? kiln_cells_ratio(reports->of, last) : 1.0, KILN_TAIL_RATIO_MOST);
    const int status = kiln_exact_reduce(in->communicator, l->group_now, l->group_count, error);
    double mean = 0.0, square = 0.0;
    size_t lit = 0;
    for (size_t i = 0; i < l->group_count; i++) {
        l->group_total[i] += kiln_exact_value(&l->group_now[i], l->unit);
        mean += l->group_total[i];
        lit += l->group_total[i] > 0.0;
    }
    mean = lit > 0 ? mean / (double)lit : 0.0;
    for (size_t i = 0; i < l->group_count; i++) {
        const double now = kiln_exact_value(&l->group_now[i], l->unit);
        const double off = fabs(now - q * l->group_before[i]) / (1.0 - q);
        const double all = l->group_total[i] + now * q / (1.0 - q) + 1e-3 * mean;
        if (l->group_total[i] > 0.0 && all > 0.0)
            square += off / all * (off / all);
        l->group_before[i] = now;
    }
    *tail_error = lit > 0 ? sqrt(square / (double)lit) : 0.0;
    return status;
}

/* Relative error of all light that follows from that of the tail; where the tail is left out, the tail. */
static double error_of_all(const struct kiln_tail_fit *fit, double share, bool left_out)
{
    if (fit->diverges)
        return KILN_TAIL_DIVERGES;
    return left_out ? share : fmin(fit->error, 1.0) * share;
}

/* The sum of q + q^2 + ... for each channel's own ratio q. */
static void find_factors(struct kiln_integrate_report *r, size_t first, float factor[3])
{
    const struct kiln_step_reports part = kiln_part_reports(&r->steps);
    const struct kiln_step_report *reports = part.of + first;
    const size_t last = part.count - first - 1;
    double tail[3], total[3] = {0};
    struct kiln_tail_fit fit;
    kiln_cells_fit_tail(reports, last + 1, &fit);
    for (int c = 0; c < 3; c++) {
        const double now = reports[last].energy.reflected[c],
                     before = last > 0 ? reports[last - 1].energy.reflected[c] : 0.0;
        const double ratio = before > 0.0 ? fmin(fit.is_long ? fit.ratio[c] : now / before, KILN_TAIL_RATIO_MOST) : 0.0;
        r->tail_ratio[c] = ratio;
        factor[c] = (float)(ratio / (1.0 - ratio));
        tail[c] = now * ratio / (1.0 - ratio);
        for (size_t i = 0; i <= last; i++)
            total[c] += reports[i].energy.reflected[c];
        total[c] += tail[c];
    }
    const double all = kiln_luminance(total);
    r->tail_share = all > 0.0 ? kiln_luminance(tail) / all : 0.0;
    r->tail_error = error_of_all(&fit, r->tail_share, false);
}

void kiln_tail_note_left(struct kiln_integrate_report *r)
{
    struct kiln_tail_fit fit;
    const struct kiln_step_reports part = kiln_part_reports(&r->steps);
    const struct kiln_step_report *reports = part.of;
    kiln_cells_fit_tail(reports, part.count, &fit);
    const double q = fmin(kiln_luminance(fit.ratio), KILN_TAIL_RATIO_MOST),
                 left = kiln_luminance(reports[part.count - 1].energy.reflected) * q / (1.0 - q);
    double all = left;
    for (size_t i = 0; i < part.count; i++)
        all += kiln_luminance(reports[i].energy.reflected);
    r->tail_error = error_of_all(&fit, all > 0.0 ? left / all : 0.0, true);
}

void kiln_tail_add(const struct kiln_integration *in)
{
    const struct kiln_rank_data *own = in->solution->own;
    const uint32_t *compact = kiln_next_compact(own);
    const bool is_compact = kiln_solution_step(in->solution)->step.compact;
    const double scale = kiln_radiosity_allgather_scale(in->solution->allgather);
    float factor[3];
    find_factors(&in->solution->report, kiln_cells_first(in->settings), factor);
    in->solution->report.tail = true;
    for (uint64_t i = 0; i < own->surface.count; i++) {
        float last[3];
        if (is_compact)
            kiln_radiosity_expand(compact[i], scale, last);
        else
            kiln_radiosity_unpack(own->next[i], last);
        for (uint64_t c = 0; c < 3; c++)
            own->sum[3 * i + c] += factor[c] * last[c];
    }
}
