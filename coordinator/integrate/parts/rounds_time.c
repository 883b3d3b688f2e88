#include "coordinator/integrate/parts/rounds_time.h"

#include <math.h>

#include "coordinator/integrate/parts/rounds.h"
#include "coordinator/run/control.h"

#define SAFETY 1.25     /* factor on the expected time of a round beside a limit that must not be passed */
#define SAFETY_TIME 1.3 /* likewise with --time: beside its steps a round is judged, and waits */

/* The last round of the reports: its first report, and its seconds. */
struct last_round {
    size_t first;
    double again; /* s, in steps that the next round has, too */
};

static struct last_round find_last(const struct kiln_integrate_settings *settings,
                                   const struct kiln_step_reports *steps)
{
    const uint32_t number = steps->of[steps->count - 1].step.part / KILN_PARTS;
    struct last_round found = {.first = steps->count};
    for (; found.first > 0 && steps->of[found.first - 1].step.part / KILN_PARTS == number; found.first--) {
        const struct kiln_step_report *report = &steps->of[found.first - 1];
        const double seconds = report->seconds + report->exchange_seconds + report->probe_seconds;
        const bool bounces = report->step.bounce > 0 && !report->step.terminal;
        found.again += settings->published_error > 0.0 && bounces ? 0.0 : seconds;
    }
    return found;
}

/* Rank 0: seconds that the next round may take; INFINITY: any. */
static double seconds_left(const struct kiln_integrate_params *p)
{
    const double limit = p->settings->published_error > 0.0 ? p->settings->time : 0.0,
                 left = p->settings->published_error > 0.0 ? INFINITY : kiln_control_seconds_left(p->control);
    if (limit > 0.0)
        return (limit - (MPI_Wtime() - p->begin) - p->after_light) / SAFETY_TIME;
    return left / SAFETY;
}

/* The level that --rounds gives; 0: there is no further round. */
static uint32_t given_level(const struct kiln_round_list *list, const struct kiln_step_reports *steps)
{
    const uint32_t number = steps->of[steps->count - 1].step.part / KILN_PARTS;
    return number < list->count ? list->levels[number] : 0;
}

bool kiln_round_fit(const struct kiln_integrate_params *p, const struct kiln_step_reports *steps,
                    struct kiln_round *round)
{
    const struct last_round last = find_last(p->settings, steps);
    const double left = seconds_left(p);
    const uint64_t now = kiln_round_times(round->from),
                   before = last.first > 0 ? kiln_round_times(steps->of[last.first - 1].round.from) : 0;
    const double share =
                     last.first > 0 && p->settings->published_error > 0.0 ? steps->of[last.first - 1].round.share : 1.0,
                 next = p->settings->published_error > 0.0 ? round->share : 1.0;
    uint32_t to = round->to;
    if (p->settings->rounds.given) {
        to = given_level(&p->settings->rounds, steps);
        round->to = to > round->from ? to : 0;
        return false;
    }
    while (isfinite(left) && to > round->from &&
           left < last.again * next / share * (double)(kiln_round_times(to) - now) / (double)(now - before))
        to--;
    (void)MPI_Bcast(&to, 1, MPI_UINT32_T, 0, p->communicator);
    const bool late = to < round->to;
    round->to = to > round->from ? to : 0;
    return late && round->to == 0;
}
