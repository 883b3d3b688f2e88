#include "coordinator/integrate/ledger.h"

#include <math.h>
#include <string.h>

#include "worker/base/memory.h"
#include "worker/pass/caustic.h"
#include "worker/pass/pass.h"

/* Groups are made of tiles, not of cells: the cell size must not change a result. */
enum { GROUP_TILES = 16 };

int kiln_ledger_create(struct kiln_ledger *ledger, const struct kiln_surface *surface, double emitted,
                       struct kiln_error *error)
{
    *ledger = (struct kiln_ledger){.unit = kiln_exact_unit(emitted),
                                   .unit_squared = kiln_exact_unit(emitted * emitted),
                                   .group_count = (size_t)(surface->tile_count / GROUP_TILES) + 1};
    const size_t count = ledger->group_count;
    const char *what = "the groups' powers";
    int status = kiln_allocate(&ledger->group_now, count, sizeof *ledger->group_now, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&ledger->group_before, count, sizeof *ledger->group_before, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&ledger->group_total, count, sizeof *ledger->group_total, what, error);
    return status;
}

void kiln_ledger_release(struct kiln_ledger *ledger)
{
    kiln_free(&ledger->group_now);
    kiln_free(&ledger->group_before);
    kiln_free(&ledger->group_total);
}

double kiln_ledger_power(const struct kiln_ledger *ledger) { return ldexp(ledger->unit, 82); }

void kiln_ledger_forget_groups(struct kiln_ledger *ledger)
{
    memset(ledger->group_before, 0, ledger->group_count * sizeof *ledger->group_before);
    memset(ledger->group_total, 0, ledger->group_count * sizeof *ledger->group_total);
}

void kiln_ledger_begin_step(struct kiln_ledger *ledger)
{
    memset(ledger->sums, 0, sizeof ledger->sums);
    ledger->variance.value = 0;
    memset(ledger->group_now, 0, ledger->group_count * sizeof *ledger->group_now);
}

/* What becomes of the radiosity that a point sends, by a gather's rays; returns the variance of what is lost of it,
 * times the samples. */
static double add_sent(const struct kiln_ledger_point *point, const struct kiln_point_mean *r, double per_unit,
                       struct kiln_exact_sum sums[KILN_SUMS])
{
    const double glass[3] = {(double)r->glass[0], (double)r->glass[1], (double)r->glass[2]};
    const double gloss[3] = {(double)r->gloss[0], (double)r->gloss[1], (double)r->gloss[2]};
    const double lost =
        fmin(1.0, (double)r->escaped + (double)r->blocked + kiln_luminance(glass) + fmax(0.0, kiln_luminance(gloss)));
    const bool all_arrives = !(lost > 0.0) && !(kiln_luminance(gloss) < 0.0);
    bool taken = false; /* by glass or gloss: else there is nothing to add */
    for (int c = 0; c < 3; c++)
        taken = taken || glass[c] < 0.0 || glass[c] > 0.0 || gloss[c] < 0.0 || gloss[c] > 0.0;
    double power[3];
    for (int c = 0; c < 3; c++) {
        power[c] = point->area * (double)point->sent[c];
        kiln_exact_add(&sums[KILN_SUM_SENT + c], power[c], per_unit);
        if (all_arrives)
            continue;
        kiln_exact_add(&sums[KILN_SUM_ESCAPED + c], power[c] * (double)r->escaped, per_unit);
        kiln_exact_add(&sums[KILN_SUM_BLOCKED + c], power[c] * (double)r->blocked, per_unit);
        if (!taken)
            continue;
        kiln_exact_add(&sums[KILN_SUM_GLASS + c], power[c] * glass[c], per_unit);
        kiln_exact_add(&sums[KILN_SUM_GLOSS + c], power[c] * gloss[c], per_unit);
    }
    const double luminance = kiln_luminance(power);
    return luminance * luminance * lost * (1.0 - lost);
}

void kiln_tally_add(const struct kiln_ledger_point *point, const struct kiln_point_mean *r, double unit,
                    struct kiln_tally *tally, struct kiln_tile_run_tally *tile_run)
{
    const double area = point->area, per_unit = 1.0 / unit;
    double reflected[3];
    for (int c = 0; c < 3; c++) {
        const double incident = area * (double)r->incident[c];
        reflected[c] = incident * (double)point->albedo[c];
        kiln_exact_add(&tally->sums[KILN_SUM_INCIDENT + c], incident, per_unit);
        kiln_exact_add(&tally->sums[KILN_SUM_REFLECTED + c], reflected[c], per_unit);
    }
    kiln_exact_add(&tile_run->reflected, kiln_luminance(reflected), per_unit);
    tile_run->variance += area * area * (double)r->error * (double)r->error;
    if (point->sent != NULL)
        tile_run->variance += add_sent(point, r, per_unit, tally->sums) / r->count;
}

void kiln_ledger_add(struct kiln_ledger *ledger, const struct kiln_tally *tally)
{
    for (int k = 0; k < KILN_SUMS; k++)
        ledger->sums[k].value += tally->sums[k].value;
}

static size_t group_of(const struct kiln_surface *surface, const struct kiln_tile_run *f)
{
    return (size_t)((surface->lightmaps[f->map].tile_first + f->tile) / GROUP_TILES);
}

void kiln_ledger_add_tile_run(struct kiln_ledger *ledger, const struct kiln_surface *surface,
                              const struct kiln_tile_run *tile_run, const struct kiln_tile_run_tally *tally)
{
    ledger->group_now[group_of(surface, tile_run)].value += tally->reflected.value;
    kiln_exact_add(&ledger->variance, tally->variance, 1.0 / ledger->unit_squared);
}

int kiln_ledger_end_step(struct kiln_ledger *ledger, MPI_Comm communicator, struct kiln_step_energy *energy,
                         struct kiln_error *error)
{
    struct kiln_exact_sum sums[KILN_SUMS + 1];
    memcpy(sums, ledger->sums, sizeof ledger->sums);
    sums[KILN_SUMS] = ledger->variance;
    const int status = kiln_exact_reduce(communicator, sums, KILN_SUMS + 1, error);
    for (int c = 0; c < 3; c++) {
        energy->incident[c] = kiln_exact_value(&sums[KILN_SUM_INCIDENT + c], ledger->unit);
        energy->reflected[c] = kiln_exact_value(&sums[KILN_SUM_REFLECTED + c], ledger->unit);
        energy->sent[c] = kiln_exact_value(&sums[KILN_SUM_SENT + c], ledger->unit);
        energy->escaped[c] = kiln_exact_value(&sums[KILN_SUM_ESCAPED + c], ledger->unit);
        energy->blocked[c] = kiln_exact_value(&sums[KILN_SUM_BLOCKED + c], ledger->unit);
        energy->glass[c] = kiln_exact_value(&sums[KILN_SUM_GLASS + c], ledger->unit);
        energy->gloss[c] = kiln_exact_value(&sums[KILN_SUM_GLOSS + c], ledger->unit);
    }
    energy->variance = kiln_exact_value(&sums[KILN_SUMS], ledger->unit_squared);
    return status;
}

/* What the lights send. */
static void open_energy(struct kiln_energy *e, const struct kiln_emission_result *light, enum kiln_caustics caustics)
{
    for (int c = 0; c < 3; c++) {
        e->emitted[c] = light->emitted[c];
        e->escaped[c] = light->escaped[c];
        e->blocked[c] = light->blocked[c];
        e->ranged[c] = light->ranged[c];
        e->glass[c] = light->glass[c];
        e->gloss[c] = light->gloss[c];
        e->unfound[c] = caustics == KILN_CAUSTICS_GATHER ? light->mirrored[c]
                        : caustics >= KILN_CAUSTICS_LAND ? 0.0
                                                         : light->caustic[c];
        e->absorbed[c] = e->left_over[c] = 0.0;
    }
}

/* What a counted step found, of which the bake has `share`: one part's. */
static void add_step(struct kiln_energy *e, const struct kiln_step_energy *p, double share)
{
    for (int c = 0; c < 3; c++) {
        e->absorbed[c] += share * (p->incident[c] - p->reflected[c]);
        e->escaped[c] += share * p->escaped[c];
        e->blocked[c] += share * p->blocked[c];
        e->glass[c] += share * p->glass[c];
        e->gloss[c] += share * p->gloss[c];
        e->left_over[c] += share * (p->reflected[c] - p->sent[c]);
    }
}

/* Light that steps of the pass found, against `traced` with its standard error. */
static struct kiln_first_light compare_first(const struct kiln_step_reports *steps, const struct kiln_pass *pass,
                                             double share, const double traced[3], const double error[3])
{
    struct kiln_first_light light = {.compared = false};
    const double traced_error = kiln_luminance(error);
    double variance = 0.0;
    for (size_t i = 0; i < steps->count; i++) {
        const struct kiln_step_report *report = &steps->of[i];
        if (!report->step.counted || report->step.pass != pass)
            continue;
        light.compared = true;
        variance += share * share * report->energy.variance;
        for (int c = 0; c < 3; c++)
            light.found[c] += share * report->energy.incident[c];
    }
    memcpy(light.traced, traced, sizeof light.traced);
    light.difference = kiln_luminance(light.found) - kiln_luminance(traced);
    light.error = sqrt(variance + traced_error * traced_error);
    return light;
}

static void compare_firsts(struct kiln_energy *e, const struct kiln_step_reports *steps,
                           const struct kiln_emission_result *emission, double share)
{
    double straight[3], caustic[3];
    for (int c = 0; c < 3; c++) {
        straight[c] = emission->received[c] - emission->caustic[c];
        caustic[c] = emission->caustic[c] - e->unfound[c];
    }
    e->straight = compare_first(steps, &kiln_pass_direct, share, straight, emission->straight_error);
    e->caustic = compare_first(steps, &kiln_pass_caustic, share, caustic, emission->caustic_error);
}

void kiln_energy_close(struct kiln_energy *e, const struct kiln_step_reports *steps,
                       const struct kiln_emission_result *emission, enum kiln_caustics caustics)
{
    double variance = 0.0, residual[3];
    uint32_t parts = 1;
    open_energy(e, emission, caustics);
    for (size_t i = 0; i < steps->count; i++)
        if (steps->of[i].step.counted && steps->of[i].step.part + 1 > parts)
            parts = steps->of[i].step.part + 1;
    const double share = 1.0 / parts;
    for (size_t i = 0; i < steps->count; i++) {
        if (!steps->of[i].step.counted)
            continue;
        add_step(e, &steps->of[i].energy, share);
        variance += share * share * steps->of[i].energy.variance;
    }
    for (int c = 0; c < 3; c++)
        residual[c] = e->emitted[c] - e->absorbed[c] - e->escaped[c] - e->blocked[c] - e->ranged[c] - e->glass[c] -
                      e->gloss[c] - e->unfound[c] - e->left_over[c];
    e->residual = kiln_luminance(residual);
    const double emission_error = kiln_luminance(emission->error), emitted = kiln_luminance(e->emitted);
    e->error = sqrt(variance + emission_error * emission_error);
    e->relative = emitted > 0.0 ? fabs(e->residual) / emitted : 0.0;
    compare_firsts(e, steps, emission, share);
}
