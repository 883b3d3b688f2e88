#include "coordinator/integrate/ledger.h"

#include <math.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/clones.h"
#include "worker/pass/caustic.h"
#include "worker/pass/pass.h"

/* Groups are made of tiles, not of cells: the cell size must not change a result. */
enum { GROUP_TILES = 16 };
static const double ROUNDING = 1e-9; /* rounding error of differences, relative to the sums */

int kiln_ledger_create(struct kiln_ledger *ledger, const struct kiln_surface *surface, double emitted,
                       struct kiln_error *error)
{
    *ledger = (struct kiln_ledger){.unit = kiln_exact_unit(emitted),
                                   .unit_squared = kiln_exact_unit(emitted * emitted),
                                   .group_count = (size_t)(surface->tile_count / GROUP_TILES) + 1};
    const size_t count = ledger->group_count;
    const char *what = "the groups' powers";
    int status;
    KILN_TRY(kiln_arena_allocate(&ledger->arena, &ledger->group_now, count, sizeof *ledger->group_now, what, error));
    KILN_TRY(
        kiln_arena_allocate(&ledger->arena, &ledger->group_before, count, sizeof *ledger->group_before, what, error));
    KILN_TRY(
        kiln_arena_allocate(&ledger->arena, &ledger->group_total, count, sizeof *ledger->group_total, what, error));
end:
    return status;
}

void kiln_ledger_release(struct kiln_ledger *ledger) { kiln_arena_release(&ledger->arena); }

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

/* Adds up the fate of the radiosity that a point sends, as found by its gather rays. Returns the variance of the lost
 * part, times the number of samples. */
static double add_sent(const struct kiln_ledger_point *point, const struct kiln_point_mean *r, double per_unit,
                       struct kiln_exact_sum sums[KILN_SUMS])
{
    const double glass[3] = {(double)r->glass[0], (double)r->glass[1], (double)r->glass[2]};
    const double gloss[3] = {(double)r->gloss[0], (double)r->gloss[1], (double)r->gloss[2]};
    const double lost =
        fmin(1.0, (double)r->escaped + (double)r->blocked + kiln_luminance(glass) + fmax(0.0, kiln_luminance(gloss)));
    const bool all_arrives = !(lost > 0.0) && !(kiln_luminance(gloss) < 0.0);
    bool taken = false; /* whether glass or gloss has taken light; otherwise there is nothing to add */
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

/* ---- many points at once ---- */

typedef double doubles __attribute__((vector_size(32), aligned(8)));
typedef int64_t masks __attribute__((vector_size(32)));
enum { WIDTH = sizeof(doubles) / sizeof(double) };
#define STEPS_MOST 0x1p90 /* limit for which the upper parts of a tile run's terms have an exact sum */

#define SPREAD(value) ((doubles){(value), (value), (value), (value)})
/* Rounds x, from 0 to 2^51, down to a whole number; `near`: x rounded to nearest. */
#define NEAREST(x) (((x) + SPREAD(0x1.8p52)) - SPREAD(0x1.8p52))
#define BELOW(x, near) ((near) - (doubles)((masks)SPREAD(1.0) & (masks)((near) > (x))))

/* Adds `count` terms to the sum, as kiln_exact_add would one by one. Terms are padded with zeros to a multiple of
 * WIDTH. Each is split into an upper part, in units of 2^40, and a lower part, in units of 1. Both are whole numbers,
 * so the doubles' sum of 64 of them is exact. */
static inline __attribute__((always_inline)) void add_terms(struct kiln_exact_sum *sum, const double *terms,
                                                            uint32_t count, double per_unit)
{
    doubles high = SPREAD(0.0), low = SPREAD(0.0);
    masks odd = {0, 0, 0, 0};
    for (uint32_t k = 0; k < count; k += WIDTH) {
        const doubles steps = *(const doubles *)(const void *)(terms + k) * SPREAD(per_unit);
        const doubles many = steps * SPREAD(0x1p-40), near = NEAREST(many), up = BELOW(many, near);
        const doubles rest = steps - up * SPREAD(0x1p40), near_rest = NEAREST(rest);
        odd |= (masks)(steps < SPREAD(0.0)) | ~(masks)(steps < SPREAD(STEPS_MOST));
        high += up;
        low += BELOW(rest, near_rest);
    }
    if ((odd[0] | odd[1] | odd[2] | odd[3]) != 0) {
        for (uint32_t k = 0; k < count; k++)
            kiln_exact_add(sum, terms[k], per_unit);
        return;
    }
    sum->value += ((__int128)(int64_t)(high[0] + high[1] + high[2] + high[3]) * ((int64_t)1 << 40)) +
                  (int64_t)(low[0] + low[1] + low[2] + low[3]);
}

void kiln_tally_note(struct kiln_tally_run *run, const struct kiln_ledger_point *point, const struct kiln_point_mean *r)
{
    const uint32_t k = run->count++;
    run->area[k] = point->area;
    run->error[k] = (double)r->error;
    for (int c = 0; c < 3; c++) {
        run->incident[c][k] = (double)r->incident[c];
        run->albedo[c][k] = (double)point->albedo[c];
    }
    run->sends = point->sent != NULL;
    if (!run->sends)
        return;
    for (int c = 0; c < 3; c++)
        run->sent[c][k] = (double)point->sent[c];
    run->escaped[k] = (double)r->escaped;
    run->blocked[k] = (double)r->blocked;
    run->samples[k] = (double)r->count;
}

/* Multiplies the first `count` values, and pads the products with zeros to a multiple of WIDTH. */
static inline __attribute__((always_inline)) void multiply(double *product, const double *a, const double *b,
                                                           uint32_t count)
{
    uint32_t k = 0;
    for (; k < count; k++)
        product[k] = a[k] * b[k];
    for (; k % WIDTH != 0; k++)
        product[k] = 0.0;
}

static inline __attribute__((always_inline)) void add_arrived(const struct kiln_tally_run *run, double per_unit,
                                                              struct kiln_tally *tally,
                                                              struct kiln_tile_run_tally *tile_run)
{
    double terms[KILN_TILE_TEXELS], reflected[3][KILN_TILE_TEXELS], luminance[KILN_TILE_TEXELS] = {0.0};
    for (int c = 0; c < 3; c++) {
        multiply(terms, run->incident[c], run->area, run->count);
        multiply(reflected[c], terms, run->albedo[c], run->count);
        add_terms(&tally->sums[KILN_SUM_INCIDENT + c], terms, run->count, per_unit);
        add_terms(&tally->sums[KILN_SUM_REFLECTED + c], reflected[c], run->count, per_unit);
    }
    for (uint32_t k = 0; k < run->count; k++) {
        const double rgb[3] = {reflected[0][k], reflected[1][k], reflected[2][k]};
        luminance[k] = kiln_luminance(rgb);
    }
    add_terms(&tile_run->reflected, luminance, run->count, per_unit);
}

/* Adds up what became of the power that the points sent: the sum of all, and the parts that escaped or fell on backs.
 * variance[k]: variance of the lost part of point k, luminance. */
static inline __attribute__((always_inline)) void add_gone(const struct kiln_tally_run *run, double per_unit,
                                                           struct kiln_tally *tally, double *variance)
{
    double power[3][KILN_TILE_TEXELS], terms[KILN_TILE_TEXELS];
    for (int c = 0; c < 3; c++) {
        multiply(power[c], run->sent[c], run->area, run->count);
        add_terms(&tally->sums[KILN_SUM_SENT + c], power[c], run->count, per_unit);
        multiply(terms, power[c], run->escaped, run->count);
        add_terms(&tally->sums[KILN_SUM_ESCAPED + c], terms, run->count, per_unit);
        multiply(terms, power[c], run->blocked, run->count);
        add_terms(&tally->sums[KILN_SUM_BLOCKED + c], terms, run->count, per_unit);
    }
    for (uint32_t k = 0; k < run->count; k++) {
        const double rgb[3] = {power[0][k], power[1][k], power[2][k]}, luminance = kiln_luminance(rgb),
                     all = run->escaped[k] + run->blocked[k], lost = all < 1.0 ? all : 1.0;
        variance[k] = luminance * luminance * lost * (1.0 - lost) / run->samples[k];
    }
}

KILN_CLONES void kiln_tally_add_run(const struct kiln_tally_run *run, double unit, struct kiln_tally *tally,
                                    struct kiln_tile_run_tally *tile_run)
{
    double variance[KILN_TILE_TEXELS] = {0.0};
    const double per_unit = 1.0 / unit;
    add_arrived(run, per_unit, tally, tile_run);
    if (run->sends)
        add_gone(run, per_unit, tally, variance);
    for (uint32_t k = 0; k < run->count; k++) {
        tile_run->variance += run->area[k] * run->area[k] * run->error[k] * run->error[k];
        if (run->sends)
            tile_run->variance += variance[k];
    }
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
    if (kiln_map_is_result(surface, tile_run->map))
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

/* Enters the power that lights send. */
static void open_energy(struct kiln_energy *e, const struct kiln_emission_result *light, enum kiln_caustics caustics)
{
    for (int c = 0; c < 3; c++) {
        e->emitted[c] = light->emitted[c];
        e->textured[c] = light->textured[c];
        e->drawn[c] = light->drawn[c];
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
    e->drawn_error = kiln_luminance(light->drawn_error);
}

/* Adds the powers of a counted step. `share`: weight of the step's part in the bake. */
static void add_step(struct kiln_energy *e, const struct kiln_step_energy *p, double share, double albedo_scale)
{
    const double read = share * albedo_scale;
    for (int c = 0; c < 3; c++) {
        e->absorbed[c] += share * (p->incident[c] - p->reflected[c] + (1.0 - albedo_scale) * p->sent[c]);
        e->escaped[c] += read * p->escaped[c];
        e->blocked[c] += read * p->blocked[c];
        e->glass[c] += read * p->glass[c];
        e->gloss[c] += read * p->gloss[c];
        e->unfound[c] += share * p->unfound[c];
        e->left_over[c] += share * (p->reflected[c] - p->sent[c]);
    }
}

/* Compares light that steps of the pass found with `traced` light and its standard error. */
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
    e->caustic.compared = e->caustic.compared && !kiln_caustics_found(steps).left_out;
}

/* Returns the luminance of the power that falls on backs and should not. Light of suns and sky may fall on the outside
 * of rooms; so may its bounced light there, as far as it can be told apart. Rounding errors count as 0. */
static double find_lost(const struct kiln_energy *e, const struct kiln_emission_result *light)
{
    const double all = kiln_luminance(e->blocked), straight = kiln_luminance(light->blocked),
                 received = kiln_luminance(light->received), bounced = fmax(0.0, all - straight),
                 of_outside = received > 0.0 ? bounced * fmin(1.0, light->from_outside / received) : 0.0;
    const double lost = straight - light->outside + light->astray + bounced - fmin(of_outside, light->on_rooms);
    return lost > ROUNDING * all ? lost : 0.0;
}

void kiln_energy_close(struct kiln_energy *e, const struct kiln_step_reports *steps,
                       const struct kiln_emission_result *emission, const struct kiln_energy_closing *closing)
{
    double variance = 0.0, residual[3];
    uint32_t parts = 1;
    open_energy(e, emission, closing->caustics);
    for (size_t i = 0; i < steps->count; i++)
        if (steps->of[i].step.counted && steps->of[i].step.part + 1 > parts)
            parts = steps->of[i].step.part + 1;
    const double share = 1.0 / parts;
    for (size_t i = 0; i < steps->count; i++) {
        if (!steps->of[i].step.counted)
            continue;
        add_step(e, &steps->of[i].energy, share, closing->albedo_scale);
        variance += share * share * steps->of[i].energy.variance;
    }
    for (int c = 0; c < 3; c++)
        residual[c] = e->emitted[c] - e->absorbed[c] - e->escaped[c] - e->blocked[c] - e->ranged[c] - e->glass[c] -
                      e->gloss[c] - e->unfound[c] - e->left_over[c];
    e->lost = find_lost(e, emission);
    e->residual = kiln_luminance(residual);
    const double emission_error = kiln_luminance(emission->error), emitted = kiln_luminance(e->emitted);
    e->error = sqrt(variance + emission_error * emission_error);
    e->relative = emitted > 0.0 ? fabs(e->residual) / emitted : 0.0;
    compare_firsts(e, steps, emission, share);
}
