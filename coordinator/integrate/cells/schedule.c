#include "coordinator/integrate/cells/schedule.h"

#include <math.h>

#include "coordinator/integrate/companion.h"
#include "coordinator/field/field.h"
#include "coordinator/integrate/cells/adapt.h"
#include "coordinator/integrate/cells/cells.h"
#include "coordinator/integrate/cells/late.h"
#include "worker/pass/caustic.h"
#include "worker/pass/guided.h"

#define LONG_TAIL_RATIO 0.8 /* of a bounce to the one before */
#define LEAST_LEFT 1e-5     /* equal schedule: reflected power of a bounce over that of all, after which none comes */
#define LEAST_LIGHT 1e-7    /* lean schedule: likewise */
#define TAIL_ERROR 2e-3     /* lean schedule: step_report.tail_error with which the tail is good enough */
/* Lean schedule: limits of step_report.object_error. If any object's mean has ever been off by more than the first,
 * bounces continue until all are within the second twice in succession, since once may be chance. */
#define OBJECT_ERROR_MOST 3e-3
#define OBJECT_ERROR_GOOD 2e-3
#define FINE_TARGET 0.02 /* error of published light that these are for */
enum {
    LEAST_BOUNCES = 3,      /* bounces before the ratio of two is trusted */
    DIVERGING_BOUNCES = 32, /* bounces before a sum is taken for divergent */
    LEAST_SAMPLES = 2,      /* of a bounce, lean schedule */
};

/* One of three channels, or the luminance. */
static double power_of(const double power[3], int channel)
{
    return channel == KILN_LUMINANCE ? kiln_luminance(power) : power[channel];
}

double kiln_cells_reflected(const struct kiln_step_report *reports, size_t i, int channel)
{
    const struct kiln_step_report *report = &reports[i];
    const double power = power_of(report->energy.reflected, channel);
    return report->step.role == KILN_CELLS_CAUSTIC ? power + power_of(report[-1].energy.reflected, channel) : power;
}

static double reflected(const struct kiln_step_report *report)
{
    return kiln_cells_reflected(report, 0, KILN_LUMINANCE);
}

static double reflected_by_all(const struct kiln_step_report *reports, size_t count)
{
    double total = 0.0;
    for (size_t i = 0; i < count; i++)
        total += reflected(&reports[i]);
    return total;
}

size_t kiln_cells_first(const struct kiln_integrate_settings *settings)
{
    return (size_t)(kiln_adapt_pilot(settings) > 0) + (size_t)(settings->caustics > KILN_CAUSTICS_NONE);
}

/* The share of the power of step i - 1 that step i gathers for: all, but for a late bounce (late.h). */
static double gone_on(const struct kiln_step_report *reports, size_t i, int channel)
{
    const double before = kiln_cells_reflected(reports, i - 1, channel);
    return kiln_late_is(&reports[i].step) && before > 0.0 ? power_of(reports[i].energy.sent, channel) / before : 1.0;
}

/* Returns the mean ratio of a step's power to that of the step before, over the steps from `first` to `last`. */
static double mean_ratio(const struct kiln_step_report *reports, size_t first, size_t last, int channel)
{
    double from = kiln_cells_reflected(reports, first, channel);
    for (size_t i = first + 1; i <= last; i++)
        from *= gone_on(reports, i, channel);
    return from > 0.0 && last > first
               ? pow(kiln_cells_reflected(reports, last, channel) / from, 1.0 / (double)(last - first))
               : 0.0;
}

double kiln_cells_ratio(const struct kiln_step_report *reports, size_t i)
{
    return mean_ratio(reports, i - 1, i, KILN_LUMINANCE);
}

/* Estimates dq of struct kiln_tail_fit: the error of q, the mean ratio of the steps after `first`. */
static double ratio_error(const struct kiln_step_report *reports, size_t first, size_t last, double q)
{
    const size_t middle = (first + last) / 2, steps = last - first;
    const double low = mean_ratio(reports, first, middle, KILN_LUMINANCE),
                 high = mean_ratio(reports, middle, last, KILN_LUMINANCE);
    double square = 0.0;
    for (size_t i = first + 1; i <= last; i++)
        square += (kiln_cells_ratio(reports, i) - q) * (kiln_cells_ratio(reports, i) - q);
    return fmax(0.5 * fabs(high - low), sqrt(square / (double)(steps * (steps - 1))));
}

void kiln_cells_fit_tail(const struct kiln_step_report *reports, size_t count, struct kiln_tail_fit *fit)
{
    *fit = (struct kiln_tail_fit){.is_long = count >= 2 && kiln_cells_ratio(reports, count - 1) > LONG_TAIL_RATIO};
    if (count < 2)
        return;
    const size_t last = count - 1, first = fit->is_long && last >= KILN_TAIL_BOUNCES ? last / 2 : last - 1;
    for (int c = 0; c < 3; c++) {
        fit->ratio[c] = mean_ratio(reports, first, last, c);
        fit->latest[c] = mean_ratio(reports, last - 1, last, c);
    }
    const double q = mean_ratio(reports, first, last, KILN_LUMINANCE);
    fit->diverges = q > KILN_TAIL_RATIO_MOST;
    if (!fit->is_long)
        return;
    fit->error = last < KILN_TAIL_BOUNCES || !(q < 1.0) ? 1.0 : ratio_error(reports, first, last, q) / (1.0 - q);
}

/* Whether the tail is long. A tail multiplies the rounding errors of the last bounces by 1 / (1 - ratio). With a ratio
 * as in a furnace this costs more accuracy than 4 bytes per point are worth. */
static bool tail_is_long(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                         size_t count)
{
    struct kiln_tail_fit fit;
    kiln_cells_fit_tail(reports, count, &fit);
    return kiln_cells_adds_tail(settings) && fit.is_long;
}

/* Chooses the form of the radiosity that the step after `count` others passes on. */
static void choose_form(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                        size_t count, struct kiln_step *step)
{
    step->compact = settings->schedule == KILN_SCHEDULE_LEAN && step->role != KILN_CELLS_FINAL && settings->compact &&
                    !tail_is_long(settings, reports, count);
    step->early = step->compact && (settings->bounces < 0 || (int64_t)count + 1 < settings->bounces);
}

/* Returns the error of the tail relative to all light. It is small if little light is left, for instance light between
 * white walls that hardly matters. */
static double error_by_tail(const struct kiln_tail_fit *fit, const struct kiln_step_report *reports, size_t count)
{
    const double q = fmin(kiln_luminance(fit->ratio), KILN_TAIL_RATIO_MOST),
                 left = reflected(&reports[count - 1]) * q / (1.0 - q), all = reflected_by_all(reports, count) + left;
    return all > 0.0 ? fmin(fit->error, 1.0) * left / all : 0.0;
}

/* Factor on the errors that the tail may have: a coarse target makes no use of late bounces. */
static double tolerance(const struct kiln_integrate_settings *settings)
{
    return fmax(1.0, settings->published_error / FINE_TARGET);
}

bool kiln_cells_settled(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                        size_t count)
{
    const double most = TAIL_ERROR * tolerance(settings);
    const struct kiln_step_report *last = &reports[count - 1];
    struct kiln_tail_fit fit;
    kiln_cells_fit_tail(reports, count, &fit);
    return !(reflected(last) > LEAST_LIGHT * reflected_by_all(reports, count)) ||
           (count > LEAST_BOUNCES && kiln_cells_ratio(reports, count - 1) < KILN_TAIL_RATIO_MOST &&
            last->tail_error <= most && error_by_tail(&fit, reports, count) <= most);
}

static bool objects_have_settled(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                                 size_t count)
{
    const double last = reports[count - 1].object_error, before = count > 1 ? reports[count - 2].object_error : 0.0;
    const double times = tolerance(settings);
    double most = 0.0;
    for (size_t i = 0; i < count; i++)
        most = fmax(most, reports[i].object_error);
    return most <= times * OBJECT_ERROR_MOST || !(last > 0.0) ||
           (last <= times * OBJECT_ERROR_GOOD && before > 0.0 && before <= times * OBJECT_ERROR_GOOD);
}

/* Whether a geometric series from the last step on is good enough, for the scene and for the mean of each of its
 * objects; or has no end. */
static bool has_settled(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                        size_t count)
{
    struct kiln_tail_fit fit;
    kiln_cells_fit_tail(reports, count, &fit);
    if (fit.diverges && count > DIVERGING_BOUNCES)
        return true;
    return kiln_cells_settled(settings, reports, count) && objects_have_settled(settings, reports, count);
}

/* Returns the rays per point in the bounce after `count` steps, for the lean schedule. The first bounces carry most of
 * the light, and the final gathers of all neighbours share their noise. Later bounces carry less light, averaged over
 * more surface. If a step has nearly the power of the one before, late bounces carry no less light, and get more
 * rays. */
static uint32_t bounce_samples(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                               size_t count)
{
    /* quarters of samples_bounce, from bounce 1 on; the last value repeats */
    static const uint8_t quarters[] = {12, 6, 4, 2, 2, 1};
    const size_t last = sizeof quarters / sizeof *quarters - 1;
    const bool is_long = count >= 2 && kiln_cells_ratio(reports, count - 1) > LONG_TAIL_RATIO;
    const uint64_t falling = quarters[count - 1 < last ? count - 1 : last],
                   quarter = is_long && falling < 4 ? 4 : falling;
    const uint32_t samples = (uint32_t)(quarter * settings->samples_bounce / 4);
    return samples > LEAST_SAMPLES ? samples : LEAST_SAMPLES;
}

static const struct kiln_guided_parameters learning = {.learns = true}, following = {.follows = true},
                                           both = {.learns = true, .follows = true};

static bool next_lean(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                      size_t count, struct kiln_step *step)
{
    if (settings->bounces == 0 || reports[count - 1].step.role == KILN_CELLS_FINAL)
        return false;
    const bool more = settings->goes_on       ? false
                      : settings->bounces > 0 ? (int64_t)count < settings->bounces
                                              : count <= KILN_BOUNCES_ALL && !has_settled(settings, reports, count);
    step->role = more ? KILN_CELLS_BOUNCE : KILN_CELLS_FINAL;
    step->samples = more ? bounce_samples(settings, reports, count) : settings->samples_indirect;
    step->stream = more ? step->bounce : KILN_CELLS_FINAL_STREAM;
    step->counted = !more;
    step->terminal = !more;
    if (more)
        step->with = settings->indirect_scale > 1 ? KILN_WITH(blocks) : 0;
    else
        step->with = (settings->seen_only ? KILN_WITH(seen) : 0) | (settings->final_scale > 1 ? KILN_WITH(nodes) : 0);
    if (settings->guide) {
        step->pass = &kiln_pass_guided;
        step->parameters = !more ? &following : step->bounce == 1 ? &learning : &both;
    }
    if (more && settings->bounces < 0 && step->bounce >= KILN_LATE_FIRST)
        step->samples_field = KILN_FIELD_SAMPLES_BOUNCE;
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

/* Step `count` of those before the bounces. */
static void first_step(const struct kiln_integrate_settings *settings, size_t count, struct kiln_step *step)
{
    const uint32_t pilot = kiln_adapt_pilot(settings);
    if (pilot > 0 && count == 0) {
        *step = (struct kiln_step){.pass = &kiln_pass_direct, .role = KILN_CELLS_PILOT, .samples = pilot};
        return;
    }
    if (settings->caustics > KILN_CAUSTICS_NONE && count == kiln_cells_first(settings)) {
        const bool lands = settings->caustics >= KILN_CAUSTICS_LAND;
        *step = (struct kiln_step){.pass = &kiln_pass_caustic,
                                   .role = KILN_CELLS_CAUSTIC,
                                   .samples = settings->samples_indirect,
                                   .with = lands ? KILN_WITH(landing) : 0,
                                   .iterations = lands ? settings->iterations : 0,
                                   .counted = true};
        return;
    }
    *step = (struct kiln_step){.pass = &kiln_pass_direct,
                               .role = KILN_CELLS_DIRECT,
                               .samples = settings->samples_direct - pilot,
                               .samples_field = pilot > 0 ? KILN_FIELD_SAMPLES : NULL,
                               .stream = pilot > 0 ? KILN_CELLS_DIRECT_STREAM : 0,
                               .counted = true};
}

bool kiln_cells_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step)
{
    const size_t first = kiln_cells_first(settings);
    bool any = true;
    if (count < first) {
        first_step(settings, count, step);
        return true;
    }
    reports = count > 0 ? reports + first : reports;
    count -= first;
    *step = (struct kiln_step){.pass = &kiln_pass_gather, .bounce = (uint32_t)count};
    if (count == 0)
        first_step(settings, first, step);
    else
        any = settings->schedule == KILN_SCHEDULE_EQUAL ? next_equal(settings, reports, count, step)
                                                        : next_lean(settings, reports, count, step);
    choose_form(settings, reports, count, step);
    return any;
}
