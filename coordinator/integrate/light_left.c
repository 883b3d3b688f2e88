#include "coordinator/integrate/light_left.h"

#include <math.h>
#include <mpi.h>
#include <string.h>

#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/quantity.h"
#include "coordinator/job/job.h"
#include "worker/base/memory.h"

enum {
    BOUNCES = 6,            /* of a bake, before the first part has had its own */
    SAMPLES_MOST = 1 << 11, /* of a step of a part, in the rounds of an error of published light */
};
/* before the first round has ended: its error of published light; a power below 2, as that is known badly; and samples
 * of all rounds over those of the first, at least */
#define TYPICAL_ERROR 0.2
#define TYPICAL_POWER 1.5
#define TYPICAL_LEAST 1.5
#define SHARE_TRUSTED 0.02    /* of a step: less tells nothing of its speed */
#define SHARE_HALF 0.1        /* of a step: at this, its own speed counts as much as that of earlier steps */
#define SHARE_HALF_UNEVEN 1.0 /* likewise, if points have their own samples: those without any are done at once */
#define ERROR_POWER 0.35      /* of the samples, by which an error falls in a round: they go to a part of the points */
#define STAYS 0.7             /* fraction of a round's points that another round works on, too */
#define TARGET_LEFT 0.025     /* fraction of points in unfinished tile runs that ends rounds of a target error */

/* ---- the work of a step ---- */

static uint32_t round_of(const struct kiln_step *step) { return step->part / KILN_PARTS; }

/* Index of the first step of the round that step `at` is of. */
static size_t first_of_round(const struct kiln_step_report *of, size_t at)
{
    while (at > 0 && round_of(&of[at - 1].step) == round_of(&of[at].step))
        at--;
    return at;
}

/* Samples of a point, over all points, in step `at`: later rounds leave finished points out. */
static double work_of(const struct kiln_step_report *of, size_t at)
{
    const struct kiln_step *step = &of[at].step;
    if (round_of(step) == 0 || step->samples_field == NULL)
        return step->samples;
    const size_t first = first_of_round(of, at);
    return (double)step->samples * (first > 0 ? of[first - 1].round.share : 1.0);
}

/* Seconds that step `at` is expected to take, by the steps before `known`; 0: nothing is known. */
static double expected_of(const struct kiln_step_report *of, size_t at, const double *seconds, size_t known)
{
    double all = 0.0, work = 0.0, role = -1.0;
    for (size_t i = known; i-- > 0;) {
        const double own = work_of(of, i);
        all += seconds[i];
        work += own;
        if (of[i].step.role != of[at].step.role || !(own > 0.0))
            continue;
        if (of[i].step.bounce == of[at].step.bounce)
            return seconds[i] * work_of(of, at) / own;
        if (role < 0.0)
            role = seconds[i] * work_of(of, at) / own;
    }
    return role >= 0.0 ? role : work > 0.0 ? all * work_of(of, at) / work : 0.0;
}

/* Seconds that the step under way takes in all, at index `at`. */
static double whole_of_present(const struct kiln_light_so_far *s, size_t at)
{
    const struct kiln_step_report *of = s->steps->of;
    const double spent = s->seconds[at], expected = expected_of(of, at, s->seconds, at);
    const bool one_phase = !kiln_step_has(&of[at].step, KILN_WITH(landing) | KILN_WITH(probes));
    if (!one_phase || !(s->share > SHARE_TRUSTED))
        return fmax(spent, expected);
    const double half = of[at].step.samples_field != NULL ? SHARE_HALF_UNEVEN : SHARE_HALF,
                 trust = expected > 0.0 ? s->share / (s->share + half) : 1.0;
    return fmax(spent, trust * spent / s->share + (1.0 - trust) * expected);
}

/* ---- rounds to come ---- */

double kiln_light_left_rounds(double published_error)
{
    return fmax(pow(TYPICAL_ERROR / published_error, TYPICAL_POWER), TYPICAL_LEAST);
}

/* Samples that a point has had before a round, and after it, by the round's first step: its parts follow one another in
 * a sequence. */
static void samples_of_round(const struct kiln_step *step, double *before, double *after)
{
    const double part = step->samples;
    *before = fmax((double)step->first_sample - part * (step->part % KILN_PARTS), 0.0);
    *after = *before + part * KILN_PARTS;
}

/* Samples that are needed in all, of `after` samples at the end of the round whose first step is of[first]. */
static double samples_needed(const struct kiln_integrate_settings *settings, const struct kiln_step_report *of,
                             size_t first, double before, double after)
{
    const double last = first > 0 ? of[first - 1].unfinished : 0.0;
    if (settings->published_error > 0.0) {
        const double times = first > 0 && before > 0.0
                                 ? pow(last * pow(before / after, ERROR_POWER) / settings->published_error, 2.0)
                                 : kiln_light_left_rounds(settings->published_error);
        return fmin(fmax(after * times, after), fmax((double)SAMPLES_MOST * KILN_PARTS, after));
    }
    const double share = first > 0 && before > 0.0 ? last * before / after : 0.5;
    return after * fmax(share / TARGET_LEFT, 1.0);
}

/* Whether a step is of those that later rounds have, too. */
static bool comes_again(const struct kiln_integrate_settings *settings, const struct kiln_step *step)
{
    return step->quantity == NULL && (settings->published_error == 0.0 || step->pass == &kiln_pass_direct ||
                                      step->terminal || kiln_step_has(step, KILN_WITH(landing)));
}

/* Samples of all rounds from the present one on over those of the present one, as foretold, for an error of published
 * light; 0: unknown. */
static double foretold_of(const struct kiln_light_so_far *s, const struct kiln_step_report *of, size_t first,
                          double before, double after)
{
    if (!(s->settings->published_error > 0.0))
        return 0.0;
    if (first == 0)
        return s->rounds;
    const struct kiln_foretold *foretold = &of[first - 1].foretold;
    const double present = of[first - 1].round.share * (after - before) / ((double)of[0].step.samples * KILN_PARTS);
    return foretold->tried > 0 && present > 0.0 ? foretold->samples / present : 0.0;
}

/* Seconds of the rounds after the present one, whose steps are of[first] to of[end - 1], with their seconds. */
static double left_of_rounds(const struct kiln_light_so_far *s, const struct kiln_step_report *of,
                             const double *seconds, size_t first, size_t end)
{
    const struct kiln_integrate_settings *settings = s->settings;
    double before, after, round = 0.0;
    if (!kiln_has_rounds(settings) || of[first].step.quantity != NULL)
        return 0.0;
    samples_of_round(&of[first].step, &before, &after);
    for (size_t i = first; i < end; i++)
        round += comes_again(settings, &of[i].step) ? seconds[i] : 0.0;
    const double foretold = foretold_of(s, of, first, before, after);
    if (foretold > 0.0)
        return round * fmax(foretold - 1.0, 0.0);
    const double needed = samples_needed(settings, of, first, before, after);
    return STAYS * round * (needed - after) / (after - before);
}

/* ---- all ---- */

/* The bounces that a part is expected to have: those of the last whole part, or more if the present one has more. */
static int64_t bounces_of(const struct kiln_step_report *of, size_t count)
{
    const struct kiln_step *present = &of[count - 1].step;
    uint32_t most = 0;
    for (size_t i = count; i-- > 0 && round_of(&of[i].step) == round_of(present);)
        if (of[i].step.part != present->part && of[i].step.quantity == NULL && of[i].step.bounce > most)
            most = of[i].step.bounce;
    if (most == 0)
        most = BOUNCES;
    return present->bounce >= most ? (int64_t)present->bounce + 1 : (int64_t)most;
}

/* Steps of a present round to come, as reports after those that are there, and what they are expected to take. */
struct future {
    struct kiln_step_report *of;
    double *seconds;
    size_t count, room, seconds_room;
};

static int add(struct future *f, const struct kiln_step *step)
{
    int status = kiln_grow(&f->of, &f->room, f->count + 1, sizeof *f->of, "steps to come", NULL);
    if (status == KILN_OK)
        status = kiln_grow(&f->seconds, &f->seconds_room, f->count + 1, sizeof *f->seconds, "steps to come", NULL);
    if (status == KILN_OK)
        f->of[f->count++] = (struct kiln_step_report){.step = *step};
    return status;
}

static int foresee(const struct kiln_light_so_far *s, struct future *f)
{
    const size_t known = s->steps->count;
    struct kiln_integrate_settings assumed = *s->settings;
    struct kiln_step step;
    if (assumed.bounces < 0)
        assumed.bounces = bounces_of(s->steps->of, known);
    for (size_t i = 0; i < known; i++) {
        const int status = add(f, &s->steps->of[i].step);
        if (status != KILN_OK)
            return status;
        f->of[i] = s->steps->of[i];
        f->seconds[i] = s->seconds[i];
    }
    f->seconds[known - 1] = whole_of_present(s, known - 1);
    while (kiln_steps_next(&assumed, f->of, f->count, &step)) {
        const int status = add(f, &step);
        if (status != KILN_OK)
            return status;
        f->seconds[f->count - 1] = expected_of(f->of, f->count - 1, f->seconds, known);
    }
    return KILN_OK;
}

double kiln_light_left(const struct kiln_light_so_far *s)
{
    const size_t known = s->steps->count;
    struct future f = {.of = NULL};
    double left = -1.0;
    if (known > 0 && (known > 1 || s->share > SHARE_TRUSTED) && foresee(s, &f) == KILN_OK) {
        left = left_of_rounds(s, f.of, f.seconds, first_of_round(f.of, known - 1), f.count);
        for (size_t i = known - 1; i < f.count; i++)
            left += f.seconds[i];
        left -= s->seconds[known - 1];
    }
    kiln_free(&f.of);
    kiln_free(&f.seconds);
    return left;
}

/* ---- the clock ---- */

void kiln_light_clock_step(struct kiln_light_clock *clock)
{
    const double now = MPI_Wtime();
    if (clock->steps == NULL)
        return;
    const size_t count = clock->steps->count;
    if (kiln_grow(&clock->seconds, &clock->room, count, sizeof *clock->seconds, "the clock of the steps", NULL) !=
        KILN_OK) {
        clock->count = 0;
        return;
    }
    if (clock->count > 0)
        clock->seconds[clock->count - 1] += now - clock->since;
    for (; clock->count < count; clock->count++) {
        const struct kiln_step_report *report = &clock->steps->of[clock->count];
        clock->seconds[clock->count] = report->seconds + report->exchange_seconds + report->probe_seconds;
    }
    clock->since = now;
}

double kiln_light_clock_left(void *context, double share)
{
    struct kiln_light_clock *clock = context;
    if (clock->count == 0 || clock->count != clock->steps->count)
        return -1.0;
    double *present = &clock->seconds[clock->count - 1];
    const double before = *present;
    *present += MPI_Wtime() - clock->since;
    const struct kiln_light_so_far so_far = {clock->settings, clock->steps, clock->seconds, share, clock->rounds};
    const double left = kiln_light_left(&so_far);
    *present = before;
    return left;
}

void kiln_light_clock_release(struct kiln_light_clock *clock)
{
    kiln_free(&clock->seconds);
    *clock = (struct kiln_light_clock){.count = 0};
}
