#include "coordinator/integrate/cells/schedule.h"

#include "coordinator/integrate/cells/cells.h"

#define LONG_TAIL_RATIO 0.8 /* of a bounce to the one before */
#define LEAST_LEFT 1e-5     /* equal schedule: reflected power of a bounce over that of all, after which none comes */
#define LEAST_LIGHT 1e-7    /* lean schedule: likewise */
#define TAIL_ERROR 2e-3     /* lean schedule: step_report.tail_error with which the tail is good enough */
enum { LEAST_BOUNCES = 3 }; /* before the ratio of two is believed */

static double reflected(const struct kiln_step_report *report) { return kiln_luminance(report->energy.reflected); }

static double reflected_by_all(const struct kiln_step_report *reports, size_t count)
{
    double total = 0.0;
    for (size_t i = 0; i < count; i++)
        total += reflected(&reports[i]);
    return total;
}

double kiln_cells_ratio(const struct kiln_step_report *reports, size_t i)
{
    const double before = reflected(&reports[i - 1]);
    return before > 0.0 ? reflected(&reports[i]) / before : 0.0;
}

/* A tail multiplies the rounding of the last bounces by 1 / (1 - ratio): in a furnace that costs more than 4 bytes a
 * point are worth. */
static bool tail_is_long(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                         size_t count)
{
    return kiln_cells_adds_tail(settings) && count >= 2 && kiln_cells_ratio(reports, count - 1) > LONG_TAIL_RATIO;
}

/* In which form the radiosity of the step after `count` others goes on. */
static void choose_form(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                        size_t count, struct kiln_step *step)
{
    step->compact = settings->schedule == KILN_SCHEDULE_LEAN && step->role != KILN_CELLS_FINAL && settings->compact &&
                    !tail_is_long(settings, reports, count);
    step->early = step->compact && (settings->bounces < 0 || (int64_t)count + 1 < settings->bounces);
}

/* Whether a geometric series from the last step on is good enough: two parts in a thousand. */
static bool has_settled(const struct kiln_step_report *reports, size_t count)
{
    const struct kiln_step_report *last = &reports[count - 1];
    return !(reflected(last) > LEAST_LIGHT * reflected_by_all(reports, count)) ||
           (count > LEAST_BOUNCES && kiln_cells_ratio(reports, count - 1) < KILN_TAIL_RATIO_MOST &&
            last->tail_error <= TAIL_ERROR);
}

static bool next_lean(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                      size_t count, struct kiln_step *step)
{
    if (settings->bounces == 0 || reports[count - 1].step.role == KILN_CELLS_FINAL)
        return false;
    const bool more = settings->bounces > 0 ? (int64_t)count < settings->bounces
                                            : count <= KILN_BOUNCES_ALL && !has_settled(reports, count);
    step->role = more ? KILN_CELLS_BOUNCE : KILN_CELLS_FINAL;
    step->samples = more ? settings->samples_bounce : settings->samples_indirect;
    step->stream = more ? step->bounce : KILN_CELLS_FINAL_STREAM;
    step->counted = !more;
    return true;
}

static bool next_equal(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                       size_t count, struct kiln_step *step)
{
    if ((int64_t)count > (settings->bounces >= 0 ? settings->bounces : KILN_BOUNCES_ALL))
        return false;
    step->role = KILN_CELLS_BOUNCE;
    step->samples = settings->samples_indirect;
    step->stream = step->bounce;
    step->counted = true;
    return settings->bounces >= 0 || count == 1 ||
           !(reflected(&reports[count - 1]) <= LEAST_LEFT * reflected_by_all(reports, count));
}

bool kiln_cells_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step)
{
    bool any = true;
    *step = (struct kiln_step){.pass = &kiln_pass_gather, .bounce = (uint32_t)count};
    if (count == 0)
        *step = (struct kiln_step){
            .pass = &kiln_pass_direct, .role = KILN_CELLS_DIRECT, .samples = settings->samples_direct, .counted = true};
    else
        any = settings->schedule == KILN_SCHEDULE_EQUAL ? next_equal(settings, reports, count, step)
                                                        : next_lean(settings, reports, count, step);
    choose_form(settings, reports, count, step);
    return any;
}
