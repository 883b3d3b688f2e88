#include "coordinator/integrate/cells/take.h"

#include <math.h>
#include <string.h>

#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/cells/adapt.h"
#include "coordinator/integrate/cells/cells.h"
#include "coordinator/integrate/sparse/sparse.h"
#include "coordinator/integrate/packing.h"
#include "coordinator/integrate/parts/part_caustics.h"
#include "coordinator/integrate/parts/parts.h"
#include "worker/pass/guided.h"
#include "worker/scene/radiosity.h"

static void set(float *values, struct kiln_own_point own, const float rgb[3])
{
    memcpy(values + 3 * own.at, rgb, 3 * sizeof *rgb);
}

static void add(float *values, struct kiln_own_point own, const float rgb[3])
{
    for (uint64_t c = 0; c < 3; c++)
        values[3 * own.at + c] += rgb[c];
}

/* Adds an error to those before, of which it is independent. */
static void add_error(uint16_t *errors, struct kiln_own_point own, float error)
{
    if (errors == NULL)
        return;
    const double before = (double)kiln_error_unpack(errors[own.at]);
    errors[own.at] = kiln_error_pack((float)sqrt(before * before + (double)error * (double)error));
}

/* Averages the error of a part into the errors so far. Within a part the first error is that of direct light. */
static void mix_error(uint16_t *errors, struct kiln_own_point own, float error, const struct kiln_part_weight *weight)
{
    if (errors != NULL)
        errors[own.at] = kiln_error_pack(
            (float)kiln_part_mix_error((double)kiln_error_unpack(errors[own.at]), (double)error, weight));
}

static void begin_errors(const struct kiln_taking *t, const struct kiln_rank_data *data, struct kiln_own_point own,
                         float error)
{
    mix_error(data->error, own, error, &t->weight);
    mix_error(data->error_direct, own, error, &t->weight);
    mix_error(data->error_indirect, own, 0.0f, &t->weight);
}

/* Returns the contribution of a part's error to the error of the mean over the parts so far. */
static float share_of_error(const struct kiln_taking *t, float error)
{
    return error / (float)(t->weight.before + 1.0);
}

static void add_indirect_error(const struct kiln_taking *t, const struct kiln_rank_data *data,
                               struct kiln_own_point own, float error)
{
    add_error(data->error, own, share_of_error(t, error));
    add_error(data->error_indirect, own, share_of_error(t, error));
}

/* Adds radiosity to the point's total, which is the mean over the parts so far. */
static void add_radiosity(const struct kiln_taking *t, const struct kiln_rank_data *data, struct kiln_own_point own,
                          const float radiosity[3])
{
    for (uint64_t c = 0; data->radiosity != NULL && c < 3; c++)
        data->radiosity[3 * own.at + c] += radiosity[c] / (float)(t->weight.before + 1.0);
}

/* Adds caustics, which belong to the light that the first bounce gathers. */
static void enter_caustic(const struct kiln_taking *t, const struct kiln_rank_data *data, struct kiln_own_point own,
                          const struct kiln_point_mean *r, const float radiosity[3], bool counts)
{
    add(data->sum, own, radiosity);
    if (!counts)
        return;
    add_radiosity(t, data, own, radiosity);
    kiln_part_mix(data->caustic + 3 * own.at, r->irradiance, 3, &t->weight);
    kiln_part_add(data, own, kiln_luminance_in_float(r->irradiance), t->step->part, &t->weight);
    add_error(data->error, own, share_of_error(t, r->error));
    mix_error(data->error_caustic, own, r->error, &t->weight);
}

/* Averages caustics of a later round into those before, in finished tile runs, too. */
static void mix_caustic(const struct kiln_taking *t, const struct kiln_rank_data *data, struct kiln_own_point own,
                        const struct kiln_tile_run *f, uint32_t bit, const struct kiln_point_mean *r,
                        const float radiosity[3])
{
    kiln_part_mix_caustics(data, own, f, bit, kiln_luminance_in_float(r->irradiance), radiosity, t);
    kiln_part_mix(data->caustic + 3 * own.at, r->irradiance, 3, &t->weight);
    mix_error(data->error_caustic, own, r->error, &t->weight);
    if (kiln_part_changes(data, f, t->step->part))
        add_error(data->error, own, share_of_error(t, r->error));
}

/* Starts a part of a later round with direct light, and with the caustics of earlier rounds. */
static void begin_with_caustics(const struct kiln_taking *t, const struct kiln_rank_data *data,
                                struct kiln_own_point own, const struct kiln_point_mean *r, const float radiosity[3],
                                bool counts)
{
    float sum[3] = {radiosity[0], radiosity[1], radiosity[2]}, total[3] = {radiosity[0], radiosity[1], radiosity[2]};
    kiln_part_add_caustics(data, own, t->step, sum, total);
    set(data->sum, own, sum);
    if (!counts)
        return;
    kiln_part_mix(data->direct + 3 * own.at, r->irradiance, 3, &t->weight);
    kiln_part_begin(data, own, kiln_luminance_in_float(r->irradiance) + kiln_part_caustics_light(data, own, t->step),
                    t->step->part, &t->weight);
    if (data->radiosity != NULL)
        kiln_part_mix(data->radiosity + 3 * own.at, total, 3, &t->weight);
    begin_errors(t, data, own, r->error);
}

void kiln_cells_enter(const struct kiln_taking *t, const struct kiln_rank_data *data, struct kiln_own_point own,
                      const struct kiln_point_mean *r, const float radiosity[3], bool counts)
{
    switch (t->step->role) {
    case KILN_CELLS_PILOT: /* the sum is incident light; the second step turns it into radiosity */
        set(data->direct, own, r->irradiance);
        set(data->sum, own, r->incident);
        begin_errors(t, data, own, r->error);
        break;
    case KILN_CELLS_DIRECT:
        if (kiln_part_has_caustics(data, t->step)) {
            begin_with_caustics(t, data, own, r, radiosity, counts);
            break;
        }
        set(data->sum, own, radiosity);
        if (!counts)
            break;
        kiln_part_mix(data->direct + 3 * own.at, r->irradiance, 3, &t->weight);
        kiln_part_begin(data, own, kiln_luminance_in_float(r->irradiance), t->step->part, &t->weight);
        if (data->radiosity != NULL)
            kiln_part_mix(data->radiosity + 3 * own.at, radiosity, 3, &t->weight);
        begin_errors(t, data, own, r->error);
        break;
    case KILN_CELLS_CAUSTIC:
        enter_caustic(t, data, own, r, radiosity, counts);
        break;
    case KILN_CELLS_BOUNCE:
        if (t->settings->schedule == KILN_SCHEDULE_LEAN) {
            add(data->sum, own, radiosity);
        } else { /* the irradiance of each bounce is added directly */
            add(data->sum, own, r->irradiance);
            if (counts) {
                add_indirect_error(t, data, own, r->error);
                add_radiosity(t, data, own, radiosity);
            }
        }
        break;
    case KILN_CELLS_FINAL: /* replaces the sum that it was gathered from, which everybody has packed by now */
        set(data->sum, own, r->irradiance);
        add_indirect_error(t, data, own, r->error);
        if (counts)
            add_radiosity(t, data, own, radiosity);
        break;
    }
}

void kiln_cells_send(const struct kiln_taking *t, const struct kiln_rank_data *data, struct kiln_own_point own,
                     const struct kiln_tile_run *f, uint32_t bit, const float radiosity[3], bool counts)
{
    float all[3];
    if (data->parts_radiosity == NULL || !counts)
        return;
    if (t->step->part < KILN_PARTS) {
        if (t->step->role != KILN_CELLS_PILOT && t->step->role != KILN_CELLS_BOUNCE)
            kiln_part_send(data, own, f, bit, radiosity, t->step, &t->weight, t->step->role != KILN_CELLS_DIRECT);
    } else if (t->step->role == KILN_CELLS_FINAL) { /* the sum has direct light and caustics until now */
        for (uint64_t c = 0; c < 3; c++)
            all[c] = data->sum[3 * own.at + c] + radiosity[c];
        kiln_part_send(data, own, f, bit, all, t->step, &t->weight, false);
    }
}

/* Makes random bits for rounding to the 4-byte form. The tile's bits are rotated by each texel's bit-reversed index (a
 * rotated van der Corput sequence). So the texels of each aligned square round up and down in turn, and the error of
 * their mean is much smaller than with independent bits. */
static uint32_t compact_hash(uint32_t tile, uint32_t bit)
{
    const uint32_t reversed = kiln_reverse_bits(bit) >> 22; /* 6 bits, the highest of 10 */
    return ((tile + reversed) & 1023u) | (((tile >> 10) + reversed) & 1023u) << 10 |
           (((tile >> 20) + reversed) & 1023u) << 20;
}

/* The tile's random bits for the radiosity of its points. */
static uint32_t tile_hash(const struct kiln_taking *t, const struct kiln_tile_run *f)
{
    return t->step->compact ? kiln_hash2(kiln_packing_hash(f, 0, t->step->stream), (uint32_t)t->settings->seed) : 0;
}

/* The radiosity that the next bounce gathers, in the form in which it travels. `tile`: tile_hash. */
static inline void pack_next(const struct kiln_taking *t, const struct kiln_rank_data *data, struct kiln_own_point own,
                             const struct kiln_tile_run *f, uint32_t tile, uint32_t bit, const float radiosity[3])
{
    if (t->step->compact)
        kiln_next_compact(data)[own.at] = kiln_radiosity_compact(radiosity, t->scale, compact_hash(tile, bit));
    else
        data->next[own.at] = kiln_radiosity_pack(radiosity, kiln_packing_hash(f, bit, t->step->stream + t->rounding));
}

/* A point's entry for the ledger, which sums up the powers of a step: the point's area, its albedo and the radiosity
 * that it sent. */
static struct kiln_ledger_point ledger_point(const struct kiln_surface *surface, struct kiln_own_point own,
                                             const struct kiln_point_mean *r, const float albedo[3], const float *sent)
{
    return (struct kiln_ledger_point){.area = kiln_lit_area(surface, own, r->present), .albedo = albedo, .sent = sent};
}

void kiln_cells_tally(const struct kiln_taking *t, const struct kiln_surface *surface, struct kiln_own_point own,
                      const struct kiln_point_mean *r, const float albedo[3], const float *sent,
                      struct kiln_tally *sums, struct kiln_tile_run_tally *tile_run)
{
    if (!kiln_point_valid(surface, own))
        return;
    const struct kiln_ledger_point point = ledger_point(surface, own, r, albedo, sent);
    kiln_tally_add(&point, r, t->unit, sums, tile_run);
}

/* Collects a point for the sums of its run; with `alone` it is added at once. */
static void tally(const struct kiln_taking *t, const struct kiln_surface *surface, struct kiln_own_point own,
                  const struct kiln_point_mean *r, const float albedo[3], bool alone, struct kiln_tally_run *run,
                  struct kiln_tally *sums, struct kiln_tile_run_tally *tile_run)
{
    const bool gathers = t->step->pass->reads_radiosity;
    float sent[3];
    if (!kiln_point_valid(surface, own))
        return;
    if (gathers)
        kiln_radiosity_unpack(t->radiosity[kiln_global_of_own(surface, own).at], sent);
    const struct kiln_ledger_point point = ledger_point(surface, own, r, albedo, gathers ? sent : NULL);
    if (alone)
        kiln_tally_add(&point, r, t->unit, sums, tile_run);
    else
        kiln_tally_note(run, &point, r);
}

/* Whether any of the answers has lost light to glass or gloss on its way. */
static bool any_tinted(const struct kiln_point_result *results, uint32_t count)
{
    bool any = false;
    for (uint32_t k = 0; k < count; k++)
        any = any || kiln_point_is_tinted(&results[k]);
    return any;
}

/* Combines the answers of the pilot and the second step of direct light. */
static struct kiln_point_mean combined(const struct kiln_rank_data *data, struct kiln_own_point own, double share,
                                       const struct kiln_point_mean *second)
{
    struct kiln_point_mean both = *second;
    const double rest = 1.0 - share,
                 errors[2] = {rest * (data->error != NULL ? (double)kiln_error_unpack(data->error[own.at]) : 0.0),
                              share * (double)second->error};
    for (uint64_t c = 0; c < 3; c++) {
        both.irradiance[c] =
            (float)(rest * (double)data->direct[3 * own.at + c] + share * (double)second->irradiance[c]);
        both.incident[c] = (float)(rest * (double)data->sum[3 * own.at + c] + share * (double)second->incident[c]);
    }
    both.error = (float)sqrt(errors[0] * errors[0] + errors[1] * errors[1]);
    return both;
}

/* ---- sparse steps ---- */

/* A computed point's answer, and what the points that mix it come to, by their shares: m2, and m2 times albedo and
 * times what was sent. */
struct block {
    struct kiln_point_mean mean;
    double area, albedo[3], sent[3];
};

/* Adds a point to the block's sums. `share`: the fraction of the point that uses this answer. */
static inline void add_to_block(const struct kiln_taking *t, const struct kiln_surface *surface,
                                struct kiln_own_point own, const float albedo[3], double share, struct block *block)
{
    const double area = share * (double)surface->area[own.at] * ((double)surface->visible[own.at] / 65535.0);
    float sent[3];
    kiln_radiosity_unpack(t->radiosity[kiln_global_of_own(surface, own).at], sent);
    block->area += area;
    for (int c = 0; c < 3; c++) {
        block->albedo[c] += area * (double)albedo[c];
        block->sent[c] += area * (double)sent[c];
    }
}

/* These points in the tally as one: they have one answer. */
static void tally_block(const struct kiln_taking *t, const struct block *block, struct kiln_tally *sums,
                        struct kiln_tile_run_tally *tile_run)
{
    const double present = (double)block->mean.present;
    float albedo[3], sent[3];
    for (int c = 0; c < 3 && block->area > 0.0; c++) {
        albedo[c] = (float)(block->albedo[c] / block->area);
        sent[c] = (float)(block->sent[c] / block->area);
    }
    const struct kiln_ledger_point point = {.area = block->area * present, .albedo = albedo, .sent = sent};
    if (block->area > 0.0)
        kiln_tally_add(&point, &block->mean, t->unit, sums, tile_run);
}

/* Mixes answers of computed points. Their errors may be alike, for they may share directions: they are added as if they
 * were the same. */
static struct kiln_point_mean mixed(const struct kiln_mixture *m, const struct block *blocks)
{
    struct kiln_point_mean mean = {.present = blocks[m->place[0]].mean.present,
                                   .count = blocks[m->place[0]].mean.count};
    for (uint32_t i = 0; i < m->count; i++) {
        const struct kiln_point_mean *from = &blocks[m->place[i]].mean;
        const float weight = (float)m->weight[i];
        for (int c = 0; c < 3; c++) {
            mean.irradiance[c] += weight * from->irradiance[c];
            mean.incident[c] += weight * from->incident[c];
        }
        mean.error += weight * from->error;
    }
    return mean;
}

/* A step in which some points have gathered, and the others mix the answers of these. */
static void take_sparse(const struct kiln_taking *t, const struct kiln_rank_data *data, const struct kiln_tile_run *f,
                        const struct kiln_point_result *results, bool counts, struct kiln_tally *sums,
                        struct kiln_tile_run_tally *tile_run)
{
    const uint32_t tile = tile_hash(t, f);
    const bool changes = kiln_part_changes(data, f, t->step->part);
    struct kiln_own_point own = kiln_own_of_global(&data->surface, f->first);
    struct kiln_sparse sparse;
    struct block blocks[KILN_TILE_TEXELS]; /* at the places of computed points */
    kiln_sparse_find(&sparse, t->settings, t->step, data, (size_t)(f - data->surface.tile_runs));
    for (uint32_t k = 0; k < f->count; k++)
        blocks[k] = (struct block){.mean = kiln_point_mean(&results[k])};
    const struct kiln_mixture *mixture = sparse.mixture;
    for (uint64_t rest = f->mask; rest != 0; rest &= rest - 1, own.at++, mixture++) {
        const struct kiln_point_mean mean = mixed(mixture, blocks);
        float albedo[3], radiosity[3];
        kiln_point_albedo(&data->surface, own, albedo);
        for (int c = 0; c < 3; c++)
            radiosity[c] = albedo[c] * mean.incident[c];
        for (uint32_t i = 0; counts && i < mixture->count; i++)
            add_to_block(t, &data->surface, own, albedo, mixture->weight[i], &blocks[mixture->place[i]]);
        kiln_cells_enter(t, data, own, &mean, radiosity, changes);
        pack_next(t, data, own, f, tile, (uint32_t)__builtin_ctzll(rest), radiosity);
    }
    for (uint64_t rest = counts ? sparse.selection.computed : 0; rest != 0; rest &= rest - 1)
        tally_block(t, &blocks[__builtin_ctzll(rest)], sums, tile_run);
}

/* Keeps the bounces' result for a tile run that no view sees, instead of a final gather; other points may gather from
 * it. The sum is of radiosity, including direct light and caustics. */
static void keep_bounces(const struct kiln_rank_data *data, const struct kiln_tile_run *f)
{
    const uint64_t first = kiln_own_of_global(&data->surface, f->first).at;
    for (uint64_t i = first; i < first + f->count; i++) {
        float albedo[3];
        kiln_point_albedo(&data->surface, (struct kiln_own_point){i}, albedo);
        if (data->radiosity != NULL)
            set(data->radiosity, (struct kiln_own_point){i}, data->sum + 3 * i);
        for (uint64_t c = 0; c < 3; c++) {
            const float all = albedo[c] > 0.0f ? data->sum[3 * i + c] / albedo[c] : 0.0f;
            const float before = data->direct[3 * i + c] + (data->caustic != NULL ? data->caustic[3 * i + c] : 0.0f);
            data->sum[3 * i + c] = fmaxf(0.0f, all - before);
        }
    }
}

/* Returns the answers of a tile run's points. Answers of the guided pass are copied to `points`, and their learnt
 * values are added to the guide. */
static const struct kiln_point_result *point_results(const struct kiln_taking *t, const struct kiln_rank_data *data,
                                                     const struct kiln_tile_run *f, const void *answers,
                                                     struct kiln_point_result points[KILN_TILE_TEXELS])
{
    const struct kiln_guided_result *guided = answers;
    if (t->step->pass != &kiln_pass_guided)
        return answers;
    float *guide = data->surface.guide + KILN_GUIDE_FLOATS * kiln_own_of_global(&data->surface, f->first).at;
    for (uint32_t k = 0; k < f->count; k++) {
        points[k] = guided[k].point;
        for (uint32_t i = 0; i < KILN_GUIDE_FLOATS; i++)
            *guide++ += guided[k].learnt[i];
    }
    return points;
}

/* Stores a point's result, and what the point sends to later rounds. */
static void enter_point(const struct kiln_taking *t, const struct kiln_rank_data *data, struct kiln_own_point own,
                        const struct kiln_tile_run *f, uint32_t bit, const struct kiln_point_mean *r,
                        const float radiosity[3], bool counts)
{
    const bool caustic = t->step->role == KILN_CELLS_CAUSTIC;
    if (caustic && kiln_part_has_caustics(data, t->step)) {
        mix_caustic(t, data, own, f, bit, r, radiosity);
        return;
    }
    kiln_cells_send(t, data, own, f, bit, radiosity, counts);
    kiln_cells_enter(t, data, own, r, radiosity, counts);
    if (caustic)
        kiln_part_keep_caustics(data, own, f, bit, kiln_luminance_in_float(r->irradiance), radiosity, t->step);
}

/* Takes the results of a step in which each point has its own answer. `second`: this step's weight in direct light,
 * which the pilot has begun; NULL: there was no pilot. `counts`: adds to the sums of power. */
static void take_points(const struct kiln_taking *t, const struct kiln_rank_data *data, const struct kiln_tile_run *f,
                        const struct kiln_point_result *results, const double *second, bool counts,
                        struct kiln_tally *sums, struct kiln_tile_run_tally *tile_run)
{
    const bool unfinished = kiln_part_changes(data, f, t->step->part), alone = any_tinted(results, f->count);
    const uint32_t tile = tile_hash(t, f);
    struct kiln_own_point own = kiln_own_of_global(&data->surface, f->first);
    struct kiln_tally_run run;
    run.count = 0;
    for (uint64_t rest = f->mask; rest != 0; rest &= rest - 1, own.at++, results++) {
        float albedo[3], radiosity[3];
        const struct kiln_point_mean mean = kiln_point_mean(results),
                                     r = second != NULL ? combined(data, own, *second, &mean) : mean;
        kiln_point_albedo(&data->surface, own, albedo);
        for (int c = 0; c < 3; c++)
            radiosity[c] = albedo[c] * r.incident[c];
        if (counts && t->step->role != KILN_CELLS_PILOT)
            tally(t, &data->surface, own, &r, albedo, alone, &run, sums, tile_run);
        enter_point(t, data, own, f, (uint32_t)__builtin_ctzll(rest), &r, radiosity, unfinished);
        pack_next(t, data, own, f, tile, (uint32_t)__builtin_ctzll(rest),
                  t->step->role == KILN_CELLS_CAUSTIC ? data->sum + 3 * own.at : radiosity); /* with direct light's */
    }
    if (run.count > 0)
        kiln_tally_add_run(&run, t->unit, sums, tile_run);
}

void kiln_cells_take(const struct kiln_taking *taking, const struct kiln_rank_data *data, const struct kiln_tile_run *f,
                     const void *answers, struct kiln_tally *sums, struct kiln_tile_run_tally *tile_run)
{
    const struct kiln_taking weighed = kiln_part_weigh(taking, data, f), *t = &weighed;
    struct kiln_point_result points[KILN_TILE_TEXELS];
    const struct kiln_point_result *results = point_results(t, data, f, answers, points);
    if (kiln_step_has(t->step, KILN_WITH(seen)) && data->seen[f - data->surface.tile_runs] == 0) {
        keep_bounces(data, f);
        return;
    }
    const bool second = t->step->role == KILN_CELLS_DIRECT && kiln_adapt_pilot(t->settings) > 0;
    const double share =
        second ? kiln_adapt_share(kiln_adapt_pilot(t->settings), data->samples[f - data->surface.tile_runs]) : 1.0;
    /* receiver-only objects, which rays do not meet, take no light from the scene */
    const bool counts = sums != NULL && (t->scene->objects[kiln_map_object(&data->surface, f->map)].flags &
                                         KILN_OBJECT_RECEIVER_ONLY) == 0;
    if (kiln_step_is_sparse(t->step))
        take_sparse(t, data, f, results, counts, sums, tile_run);
    else
        take_points(t, data, f, results, second ? &share : NULL, counts, sums, tile_run);
}

void kiln_cells_pack_sum(const struct kiln_rank_data *own_data)
{
    const struct kiln_surface *surface = &own_data->surface;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < surface->tile_run_count; i++) {
        const struct kiln_tile_run *f = &surface->tile_runs[i];
        struct kiln_own_point own = kiln_own_of_global(surface, f->first);
        for (uint64_t rest = f->mask; rest != 0; rest &= rest - 1, own.at++)
            own_data->next[own.at] =
                kiln_radiosity_pack(&own_data->sum[3 * own.at],
                                    kiln_packing_hash(f, (uint32_t)__builtin_ctzll(rest), KILN_CELLS_FINAL_STREAM));
    }
}
