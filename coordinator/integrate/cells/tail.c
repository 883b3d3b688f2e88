#include "coordinator/integrate/cells/tail.h"

#include <math.h>

#include "coordinator/field/radiosity_allgather.h"
#include "coordinator/integrate/cells/cells.h"
#include "coordinator/integrate/cells/late.h"
#include "coordinator/integrate/cells/schedule.h"
#include "coordinator/integrate/company.h"
#include "coordinator/integrate/parts/parts.h"
#include "worker/scene/radiosity.h"

int kiln_tail_measure(const struct kiln_integration *in, const struct kiln_step_reports *reports, double *tail_error,
                      struct kiln_error *error)
{
    struct kiln_ledger *l = in->ledger;
    const size_t last = reports->count - 1;
    const double q =
        fmin(last > kiln_cells_first(in->settings) ? kiln_cells_ratio(reports->of, last) : 1.0, KILN_TAIL_RATIO_MOST);
    const int status = kiln_exact_reduce(in->communicator, l->group_now, l->group_count, error);
    const bool goes_on = reports->of[last].step.role == KILN_CELLS_CAUSTIC; /* with what direct light was */
    double mean = 0.0, square = 0.0;
    size_t lit = 0;
    for (size_t i = 0; i < l->group_count; i++) {
        l->group_total[i] += kiln_exact_value(&l->group_now[i], l->unit);
        mean += l->group_total[i];
        lit += l->group_total[i] > 0.0;
    }
    mean = lit > 0 ? mean / (double)lit : 0.0;
    for (size_t i = 0; i < l->group_count; i++) {
        const double now = kiln_exact_value(&l->group_now[i], l->unit) + (goes_on ? l->group_before[i] : 0.0);
        const double off = fabs(now - q * l->group_before[i]) / (1.0 - q);
        const double all = l->group_total[i] + now * q / (1.0 - q) + 1e-3 * mean;
        if (l->group_total[i] > 0.0 && all > 0.0)
            square += off / all * (off / all);
        l->group_before[i] = now;
    }
    *tail_error = lit > 0 ? sqrt(square / (double)lit) : 0.0;
    return status;
}

/* Returns the relative error of all light due to the error of the tail; if the tail is left out, due to its absence. */
static double error_of_all(const struct kiln_tail_fit *fit, double share, bool left_out)
{
    if (fit->diverges)
        return KILN_TAIL_DIVERGES;
    return left_out ? share : fmin(fit->error, 1.0) * share;
}

void kiln_tail_factors(const struct kiln_tail_fit *fit, float factor[3])
{
    for (int c = 0; c < 3; c++) {
        const double ratio = fmin(fit->ratio[c], KILN_TAIL_RATIO_MOST);
        factor[c] = (float)(ratio / (1.0 - ratio));
    }
}

/* Returns the power that the ended tiles (late.h) would have sent, W. It assumes that their power falls by the ratio at
 * which they ended, or faster. */
static double left_out(const struct kiln_step_report *reports, size_t count)
{
    double power = 0.0;
    for (size_t i = 1; i < count; i++) {
        struct kiln_tail_fit fit;
        if (!kiln_late_is(&reports[i].step))
            continue;
        kiln_cells_fit_tail(reports, i, &fit);
        const double q = fmin(fmax(kiln_luminance(fit.ratio), kiln_luminance(fit.latest)), KILN_TAIL_RATIO_MOST),
                     ended =
                         kiln_cells_reflected(reports, i - 1, KILN_LUMINANCE) - kiln_luminance(reports[i].energy.sent);
        power += fmax(0.0, ended) * q / (1.0 - q);
    }
    return power;
}

/* The tail's factors, for a tail after the last step. */
static void find_factors(struct kiln_integrate_report *r, size_t first, float factor[3])
{
    const struct kiln_step_reports part = kiln_part_reports(&r->steps);
    const struct kiln_step_report *reports = part.of + first;
    const size_t last = part.count - first - 1;
    double tail[3], total[3] = {0};
    struct kiln_tail_fit fit;
    kiln_cells_fit_tail(reports, last + 1, &fit);
    kiln_tail_factors(&fit, factor);
    for (int c = 0; c < 3; c++) {
        const double ratio = fmin(fit.ratio[c], KILN_TAIL_RATIO_MOST);
        r->tail_ratio[c] = ratio;
        tail[c] = kiln_cells_reflected(reports, last, c) * ratio / (1.0 - ratio);
        for (size_t i = 0; i <= last; i++)
            total[c] += kiln_cells_reflected(reports, i, c);
        total[c] += tail[c];
    }
    const double all = kiln_luminance(total);
    r->tail_share = all > 0.0 ? kiln_luminance(tail) / all : 0.0;
    r->tail_error = error_of_all(&fit, r->tail_share, false);
    if (all > 0.0 && !fit.diverges)
        r->tail_error += left_out(reports, last + 1) / all;
    r->tail_object_error = reports[last].object_error;
}

void kiln_tail_note_left(struct kiln_integrate_report *r, size_t first)
{
    struct kiln_tail_fit fit;
    const struct kiln_step_reports part = kiln_part_reports(&r->steps);
    const struct kiln_step_report *reports = part.of + first;
    const size_t count = part.count - first;
    kiln_cells_fit_tail(reports, count, &fit);
    const double q = fmin(kiln_luminance(fit.ratio), KILN_TAIL_RATIO_MOST),
                 left = kiln_cells_reflected(reports, count - 1, KILN_LUMINANCE) * q / (1.0 - q);
    double all = left;
    for (size_t i = 0; i < count; i++)
        all += kiln_cells_reflected(reports, i, KILN_LUMINANCE);
    r->tail_error = error_of_all(&fit, all > 0.0 ? left / all : 0.0, true);
}

void kiln_tail_last(const struct kiln_integration *in, struct kiln_own_point point, float rgb[3])
{
    const struct kiln_rank_data *own = in->solution->own;
    if (kiln_solution_step(in->solution)->step.compact)
        kiln_radiosity_expand(kiln_next_compact(own)[point.at], kiln_radiosity_allgather_scale(in->solution->allgather),
                              rgb);
    else
        kiln_radiosity_unpack(own->next[point.at], rgb);
}

void kiln_tail_extend(const struct kiln_integration *in, struct kiln_own_point first, uint64_t count,
                      const float factor[3])
{
    kiln_company_extend(in->company, first, count, factor);
    for (uint64_t i = first.at; i < first.at + count; i++) {
        float last[3];
        kiln_tail_last(in, (struct kiln_own_point){i}, last);
        for (uint64_t c = 0; c < 3; c++)
            in->solution->own->sum[3 * i + c] += factor[c] * last[c];
    }
}

void kiln_tail_add(const struct kiln_integration *in)
{
    float factor[3];
    find_factors(&in->solution->report, kiln_cells_first(in->settings), factor);
    in->solution->report.tail = true;
    const struct kiln_surface *surface = &in->solution->own->surface;
#pragma omp parallel for schedule(static)
    for (size_t f = 0; f < surface->tile_run_count; f++)
        kiln_tail_extend(in, kiln_own_of_global(surface, surface->tile_runs[f].first), surface->tile_runs[f].count,
                         factor);
}
