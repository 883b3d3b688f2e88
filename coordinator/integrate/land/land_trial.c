#include "coordinator/integrate/land/land_trial.h"

#include <math.h>

#include "coordinator/field/packed_error.h"
#include "coordinator/integrate/land/land_state.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

#define DARK 0.05        /* least direct light that shares refer to, relative to the mean */
#define DENOISED 0.25    /* fraction of the stated error of direct light that denoising leaves */
#define OF_A_RAY 0.05    /* relative error of indirect light, denoised, times the root of its rays */
#define OF_TARGET 0.25   /* fraction of the target error that leaving out caustics may cost */
#define OF_PUBLISHED 0.1 /* fraction of the error of published light that caustics must bring in the mean */
#define SHARE_MOST 1e15  /* limit of a texel's share, so that sums of squares stay in range */

/* Sums over points of area times these. */
enum { AREA, DIRECT, MEAN, PRODUCT, ERROR, SUMS };

struct trial_sums {
    struct kiln_exact_sum sums[SUMS];
    double units[SUMS];
};

int kiln_land_trial_begin(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_step_reports *steps = &l->solution->report.steps;
    const size_t count = l->solution->own->surface.count;
    if (!l->params->settings->caustics_tried || !kiln_landing_gathers(l) || kiln_caustics_found(steps).tried)
        return KILN_OK;
    int status = KILN_OK;
    for (int half = 0; half < 2 && status == KILN_OK; half++)
        status = kiln_allocate(&l->tried[half], count, sizeof *l->tried[half], "the trial of caustics", error);
    return status;
}

void kiln_land_trial_add(const struct kiln_landing *l, const struct kiln_landing_list *list, int half)
{
    if (l->tried[half] == NULL)
        return;
    for (size_t i = 0; i < list->count; i++) {
        const struct kiln_landing_record *record = kiln_landing_of(list, i);
        l->tried[half][record->point] += (float)(kiln_luminance_of_floats(record->flux) * (double)record->shading);
    }
}

static void add(struct trial_sums *s, int which, double value)
{
    kiln_exact_add(&s->sums[which], value, 1.0 / s->units[which]);
}

static double value_of(const struct trial_sums *s, int which)
{
    return kiln_exact_value(&s->sums[which], s->units[which]);
}

/* Sums of a thread, zero at first. */
static struct trial_sums only_units(const struct trial_sums *s)
{
    struct trial_sums own = {.units = {0.0}};
    for (int k = 0; k < SUMS; k++)
        own.units[k] = s->units[k];
    return own;
}

/* Adds a thread's sums. They are exact, so the order of threads does not matter. */
static void add_thread(struct trial_sums *s, const struct trial_sums *own)
{
#pragma omp critical(kiln_land_trial)
    for (int k = 0; k < SUMS; k++)
        s->sums[k].value += own->sums[k].value;
}

/* Collective. Area and power of direct light of all points that can be lit. */
static int sum_direct(const struct kiln_landing *l, struct trial_sums *s, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    const size_t count = l->solution->own->surface.count;
    s->units[AREA] = kiln_exact_unit(p->area);
    s->units[DIRECT] = kiln_exact_unit(kiln_luminance(p->emission->emitted));
#pragma omp parallel num_threads((int)p->threads)
    {
        struct trial_sums own = only_units(s);
#pragma omp for schedule(static) nowait
        for (size_t i = 0; i < count; i++) {
            add(&own, AREA, (double)l->lit[i]);
            add(&own, DIRECT, (double)l->lit[i] * kiln_luminance_of_floats(l->solution->direct + 3 * i));
        }
        add_thread(s, &own);
    }
    return kiln_exact_reduce(p->communicator, s->sums, MEAN, error);
}

/* Adds a point's shares; its direct light counts as `dark` at least. */
static void add_shares(const struct kiln_landing *l, size_t i, double dark, int rounds, struct trial_sums *s)
{
    const double area = (double)l->lit[i], direct = fmax(kiln_luminance_of_floats(l->solution->direct + 3 * i), dark),
                 error = (double)kiln_error_unpack(l->solution->error[i]) / direct;
    double share[2];
    for (int half = 0; half < 2; half++)
        share[half] = fmin((double)l->tried[half][i] / (area * rounds * direct), SHARE_MOST);
    add(s, MEAN, area * 0.5 * (share[0] + share[1]));
    add(s, PRODUCT, area * share[0] * share[1]);
    add(s, ERROR, area * fmin(error * error, SHARE_MOST));
}

/* Collective. Adds up the shares of all points. */
static int sum_shares(const struct kiln_landing *l, double dark, int rounds, struct trial_sums *s,
                      struct kiln_error *error)
{
    const double area = value_of(s, AREA);
    for (int k = MEAN; k < SUMS; k++)
        s->units[k] = kiln_exact_unit(area);
#pragma omp parallel num_threads((int)l->params->threads)
    {
        struct trial_sums own = only_units(s);
#pragma omp for schedule(static) nowait
        for (size_t i = 0; i < l->solution->own->surface.count; i++)
            if (l->lit[i] > 0.0f)
                add_shares(l, i, dark, rounds, &own);
        add_thread(s, &own);
    }
    return kiln_exact_reduce(l->params->communicator, s->sums + MEAN, SUMS - MEAN, error);
}

/* Estimates the error of all light except caustics. Stated errors are those of one part's samples. */
static double rest_of(const struct kiln_integrate_settings *settings, const struct trial_sums *s)
{
    const double parts = (double)(settings->parts > 1 ? settings->parts : 1),
                 direct = DENOISED * DENOISED * value_of(s, ERROR) / value_of(s, AREA) / parts,
                 indirect = OF_A_RAY * OF_A_RAY / (double)settings->samples_indirect, rest = sqrt(direct + indirect);
    return settings->published_error > 0.0 ? OF_PUBLISHED * settings->published_error
           : settings->target_error > 0.0  ? fmin(rest, OF_TARGET * settings->target_error)
                                           : rest;
}

static void judge(const struct kiln_integrate_settings *settings, const struct trial_sums *s,
                  struct kiln_caustic_trial *trial)
{
    const double area = value_of(s, AREA);
    trial->rest = rest_of(settings, s);
    trial->brings = value_of(s, MEAN) / area;
    if (!(settings->published_error > 0.0)) /* else a few bright spots are not what 95 % of the texels wait for */
        trial->brings = fmax(trial->brings, sqrt(fmax(value_of(s, PRODUCT), 0.0) / area));
    trial->left_out = trial->brings < trial->rest;
}

int kiln_land_trial_end(struct kiln_landing *l, int rounds, struct kiln_error *error)
{
    struct kiln_caustic_trial *trial = &kiln_solution_step(l->solution)->caustics;
    struct trial_sums s = {.units = {0.0}};
    if (l->tried[0] == NULL)
        return KILN_OK;
    int status = sum_direct(l, &s, error);
    const double area = value_of(&s, AREA), direct = value_of(&s, DIRECT);
    *trial = (struct kiln_caustic_trial){.tried = true};
    if (status == KILN_OK && area > 0.0 && direct > 0.0) { /* without any other light, caustics are all light */
        status = sum_shares(l, DARK * direct / area, rounds, &s, error);
        if (status == KILN_OK)
            judge(l->params->settings, &s, trial);
    }
    for (int half = 0; half < 2; half++)
        kiln_free(&l->tried[half]);
    return status;
}

bool kiln_land_trial_leaves_out(const struct kiln_landing *l)
{
    return kiln_caustics_found(&l->solution->report.steps).left_out;
}
