/* The gather pass (worker/pass/gather.h): cosine-distributed rays from a tile run's points, and the radiosity that they
 * find. */
#include "worker/backend/embree/gather.h"

#include <math.h>
#include <string.h>

#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"
#include "worker/pass/gather.h"

void gather_work_destroy(void **work)
{
    struct gather_work *w = *work;
    if (w != NULL) {
        hemisphere_release(&w->h);
        kept_rows_release(&w->rows);
        kiln_free(&w->groups);
        directed_destroy(&w->directed);
    }
    kiln_free(work);
}

int gather_work_create(void **work, const struct embree_backend *b, const struct kiln_batch *part,
                       struct kiln_error *error)
{
    struct gather_work *w = NULL;
    int status = kiln_allocate(&w, 1, sizeof *w, "the gather pass", error);
    *work = w;
    if (status != KILN_OK)
        return status;
    w->probes.range = b->probes != NULL ? b->probes->grid.range : INFINITY;
    status = hemisphere_create(&w->h, b, part, part->stream, error);
    if (status != KILN_OK)
        gather_work_destroy(work);
    return status;
}

/* ---- the light of groups (worker/pass/groups.h) ---- */

static size_t group_sums(const struct embree_backend *b)
{
    return b->base.given.groups->lights->count * KILN_GROUP_FLOATS;
}

static int groups_create(struct gather_work *w, const struct embree_backend *b, struct kiln_error *error)
{
    return b->base.given.groups != NULL
               ? kiln_allocate(&w->groups, RAY_LANES * group_sums(b), sizeof *w->groups, "the light of groups", error)
               : KILN_OK;
}

/* Adds each group's radiosity at a surface point that a ray of point j has hit, with the ray's weights for incident
 * light and for irradiance. */
static inline void add_groups(const struct gather_work *w, const struct embree_backend *b, uint32_t j, uint64_t point,
                              float incident, float irradiance)
{
    const struct kiln_groups *g = b->base.given.groups;
    const uint64_t *radiosity = g->radiosity + point * g->lights->count;
    double *sums = w->groups + j * group_sums(b);
    for (uint32_t i = 0; i < g->lights->count; i++, sums += KILN_GROUP_FLOATS) {
        float rgb[3];
        if (radiosity[i] == 0)
            continue;
        kiln_radiosity_unpack(radiosity[i], rgb);
        for (int c = 0; c < 3; c++) {
            sums[c] += (double)(incident * rgb[c]);
            sums[3 + c] += (double)(irradiance * rgb[c]);
        }
    }
}

static void store_groups(const struct gather_work *w, const struct embree_backend *b, size_t tile_run)
{
    float *run = embree_group_run(b, tile_run);
    for (uint32_t j = 0; j < w->h.rays->frame.count; j++)
        for (size_t i = 0; i < group_sums(b); i++)
            embree_group_answers(run, b, w->h.rays->frame.place[j])[i] = (float)w->groups[j * group_sums(b) + i];
}

/* ---- sums ---- */

/* Adds radiosity that the ray of lane l has found. Returns its weight as irradiance. */
static inline float add(struct gather_work *w, uint32_t step, uint32_t l, float rgb[3], bool tints)
{
    const struct tile_run_rays *rays = w->h.rays;
    float luminance;
    const uint32_t quarter =
        w->directed != NULL ? directed_quarter(w->directed, rays, step, l) : rays_quarter(rays, step, l);
    const float weight = hemisphere_add(&w->h, l, quarter, rgb, tints, &luminance);
    if (w->guide.side > 0)
        run_guide_learn(&w->guide, rays, step, l, luminance);
    return weight;
}

/* Adds the radiosity lane by lane: for each point in the order of its samples, whatever the number of lanes. */
KILN_CLONES static void collect(const struct embree_backend *b, struct gather_work *w, uint32_t step)
{
    const struct rays_found *found = &w->h.found;
    const uint32_t count = found->count;
    const bool tints = embree_tints(b);
    const struct kiln_directions_parameters *directions = w->directions;
    const uint64_t *radiosity =
        directions != NULL && directions->radiosity != NULL ? directions->radiosity : b->radiosity;
    for (uint32_t i = 0; i < count; i++) {
        float rgb[3] = {0.0f, 0.0f, 0.0f};
        const uint32_t l = found->lane[i];
        const float facet = hemisphere_weight(w->h.rays, l);
        const bool meets = found->point[i] != KILN_NO_POINT && facet > 0.0f;
        if (meets)
            kiln_radiosity_unpack(radiosity[found->point[i]], rgb);
        for (int c = 0; c < 3 && directions != NULL; c++)
            rgb[c] *= (float)directions->scale;
        const float weight = add(w, step, l, rgb, tints);
        if (meets && w->groups != NULL)
            add_groups(w, b, w->h.rays->point[l], found->point[i], facet, weight);
    }
}

/* Stores the weights of a step's rays, for a smooth mesh. */
static void weigh(const struct gather_work *w, size_t tile_run, uint32_t step, uint32_t lanes)
{
    const struct tile_run_rays *rays = w->h.rays;
    for (uint32_t l = 0; l < lanes; l++)
        kept_rows_weigh(&w->rows, rays, tile_run, step, l, hemisphere_weight(rays, l),
                        kiln_shading_weight(hemisphere_shading_cosine(rays, l), rays->cosine[l]) * rays->weight[l]);
}

/* ---- rays that all weigh 1 ---- */

/* Whether the radiosity that rays find is added unchanged, with nothing else computed from it. */
static bool is_plain(const struct gather_work *w, const struct embree_backend *b)
{
    const struct tile_run_frame *frame = &w->h.rays->frame;
    bool plain = b->probes == NULL && !chain_any(b) && !frame->smooth && w->h.rays->guide == NULL &&
                 w->guide.side == 0 && w->directed == NULL && w->groups == NULL && !embree_tints(b);
    for (uint32_t j = 0; j < frame->count && plain; j++)
        plain = !frame->glossy[j];
    return plain;
}

/* As collect, in SIMD lanes for all points that take the same sample; the sums are in `plain`. Lanes without a hit add
 * 0. */
KILN_CLONES static void collect_plain(const struct embree_backend *b, struct gather_work *w, uint32_t step,
                                      uint32_t lanes)
{
    const struct rays_found *found = &w->h.found;
    const struct tile_run_rays *rays = w->h.rays;
    const uint32_t points = rays->frame.count;
    uint32_t low[RAY_LANES], high[RAY_LANES];
    for (uint32_t l = 0; l < lanes; l++)
        low[l] = high[l] = 0;
    for (uint32_t i = 0; i < found->count; i++) {
        const uint64_t packed = found->point[i] != KILN_NO_POINT ? b->radiosity[found->point[i]] : 0;
        low[found->lane[i]] = (uint32_t)packed;
        high[found->lane[i]] = (uint32_t)(packed >> 32);
    }
    for (uint32_t first = 0, c = 0; first < lanes; first += points, c++) {
        double *restrict quarter = w->h.quarter[rays->quarter_of[step * rays->copies + c]];
        double *restrict red = w->plain[0], *restrict green = w->plain[1], *restrict blue = w->plain[2];
        for (uint32_t j = 0; j < points; j++) {
            const uint32_t bits[3] = {kiln_radiosity_red(low[first + j]),
                                      kiln_radiosity_green(low[first + j], high[first + j]),
                                      kiln_radiosity_blue(high[first + j])};
            float rgb[3];
            memcpy(rgb, bits, sizeof rgb);
            red[j] += (double)rgb[0];
            green[j] += (double)rgb[1];
            blue[j] += (double)rgb[2];
            quarter[j] += (double)kiln_luminance_in_float(rgb);
        }
    }
}

static void take_plain(struct gather_work *w)
{
    for (uint32_t j = 0; j < w->h.rays->frame.count; j++)
        for (int c = 0; c < 3; c++)
            w->h.incident[j][c] = w->plain[c][j];
}

/* ---- with chains, and probes ---- */

/* Finds the lanes that continue in chains, and removes those from the blocked ones. */
static void find_chains(const struct embree_backend *b, struct gather_work *w)
{
    struct rays_found *found = &w->h.found;
    uint32_t blocked = 0;
    memset(w->chained, 0, sizeof w->chained);
    memset(w->h.lost, 0, sizeof w->h.lost);
    for (uint32_t i = 0; i < found->count; i++)
        w->chained[found->lane[i]] = hemisphere_is_chain(b, w->h.rays, found->lane[i]);
    for (uint32_t i = 0; i < found->blocked; i++) {
        const uint32_t l = found->blocked_lane[i];
        w->chained[l] = hemisphere_is_chain(b, w->h.rays, l);
        if (!w->chained[l])
            found->blocked_lane[blocked++] = (uint8_t)l;
    }
    found->blocked = blocked;
}

/* Follows the chain of lane l, and stores it where chains are kept. */
static void follow_and_keep(struct gather_work *w, uint32_t step, uint32_t l, bool tints)
{
    if (!kept_rows_note_chains(&w->rows)) {
        hemisphere_follow(&w->h, step, l, true);
        return;
    }
    const uint32_t j = w->h.rays->point[l];
    w->h.walk.notes = kept_chains_ray(&w->rows.chains, j, tints ? w->h.rays->tint[l] : NULL);
    hemisphere_follow(&w->h, step, l, true);
    w->h.walk.notes = NULL;
    *kept_rows_word(&w->rows, w->h.rays, step, l) = kept_chains_end(&w->rows.chains, j, tints);
}

/* Stores the tint of a ray that ends at its first surface. */
static void keep_tint(struct gather_work *w, uint32_t step, uint32_t l, uint64_t point)
{
    const float *tint = w->h.rays->tint[l], all[3] = {1.0f, 1.0f, 1.0f};
    const uint32_t j = w->h.rays->point[l];
    if (!kept_rows_note_chains(&w->rows) || (tint[0] == 1.0f && tint[1] == 1.0f && tint[2] == 1.0f))
        return;
    kept_chains_answer(kept_chains_ray(&w->rows.chains, j, tint), (uint32_t)point, all);
    *kept_rows_word(&w->rows, w->h.rays, step, l) = kept_chains_end(&w->rows.chains, j, true);
}

/* As collect_lanes, for rays read from a file. The points' records have the shares that were lost. */
static void collect_kept(const struct embree_backend *b, struct gather_work *w, uint32_t step, uint32_t lanes)
{
    for (uint32_t l = 0; l < lanes; l++) {
        float rgb[3] = {0.0f, 0.0f, 0.0f};
        const uint32_t word = *kept_rows_word(&w->rows, w->h.rays, step, l);
        if (word == KILN_ROW_ESCAPED || word == KILN_ROW_BLOCKED)
            continue;
        if (word == KILN_ROW_CHAIN || word == KILN_ROW_TINTED)
            kept_chains_light(&w->rows.chains, w->h.rays->point[l], word == KILN_ROW_TINTED, b->radiosity, rgb);
        else if (word < KILN_ROW_POINTS && hemisphere_weight(w->h.rays, l) > 0.0f)
            kiln_radiosity_unpack(b->radiosity[word], rgb);
        add(w, step, l, rgb, false);
    }
}

/* Reads the shares of the points' rays that were lost. */
static void take_lost(struct gather_work *w)
{
    for (uint32_t j = 0; j < w->h.rays->frame.count; j++) {
        const struct kiln_row_chain *record = &w->rows.chains.record[j];
        w->h.escaped[j] = (double)record->escaped;
        w->h.blocked[j] = (double)record->blocked;
        for (int c = 0; c < 3; c++) {
            w->h.glass[j][c] = (double)record->glass[c];
            w->h.gloss[j][c] = (double)record->gloss[c];
        }
    }
}

/* As count_lost and collect, where rays end at probes or continue in chains. Adds light of surfaces, probes and chains
 * lane by lane, so that a point's samples are added in order. */
static void collect_lanes(const struct embree_backend *b, struct embree_context *context, struct gather_work *w,
                          uint32_t step, uint32_t lanes)
{
    const struct rays_found *found = &w->h.found;
    const bool tints = embree_tints(b), chains = chain_any(b);
    w->probes.asking = 0;
    w->h.walk.context = context;
    if (chains)
        find_chains(b, w);
    if (b->probes != NULL)
        ray_probes_choose(&w->probes, &w->h, b, context, step);
    for (uint32_t l = 0, hit = 0, ask = 0; l < lanes; l++) {
        float rgb[3] = {0.0f, 0.0f, 0.0f};
        const bool is_hit = hit < found->count && found->lane[hit] == l,
                   asks = ask < w->probes.asking && w->probes.asks[ask] == l;
        if (chains && w->chained[l]) {
            follow_and_keep(w, step, l, tints);
            hemisphere_count_chain(&w->h, l, tints);
            memcpy(rgb, w->h.chain.radiosity, sizeof rgb);
        } else if (is_hit) {
            if (hemisphere_weight(w->h.rays, l) > 0.0f && found->point[hit] != KILN_NO_POINT) {
                kiln_radiosity_unpack(b->radiosity[found->point[hit]], rgb);
                if (tints)
                    keep_tint(w, step, l, found->point[hit]);
            }
        } else if (asks) {
            ray_probes_ask(&w->probes, &w->h, b, l, rgb);
        } else {
            continue;
        }
        hit += is_hit;
        ask += asks;
        add(w, step, l, rgb, tints);
    }
    if (chains)
        hemisphere_count_lost_in_order(&w->h, lanes);
    else
        hemisphere_count_lost(&w->h);
}

/* ---- the pass ---- */

/* Whether a ray's weight does not depend on its direction. */
static bool weighs_alike(const struct tile_run_frame *frame)
{
    bool alike = !frame->smooth;
    for (uint32_t j = 0; j < frame->count && alike; j++)
        alike = !frame->glossy[j];
    return alike;
}

static void find_kept(struct gather_work *w, const struct embree_backend *b, uint32_t step, uint32_t lanes)
{
    if (!kept_rows_find_chains(&w->rows)) /* otherwise words are read where light is collected */
        kept_rows_find(&w->rows, b, w->h.rays, step, lanes, &w->h.found);
}

/* Finds the hits of a step's rays: traces them, or with `replays` reads them. Returns the number of lanes. */
static uint32_t find_step(struct gather_work *w, const struct embree_backend *b, struct embree_context *context,
                          uint32_t step, bool replays, uint64_t *rays)
{
    if (replays && weighs_alike(&w->h.rays->frame)) { /* no sum hangs on where the rays go */
        const uint32_t lanes = rays_lanes(w->h.rays, step);
        find_kept(w, b, step, lanes);
        return lanes;
    }
    const uint32_t lanes = rays_make(w->h.rays, b, step);
    if (replays) {
        find_kept(w, b, step, lanes);
        return lanes;
    }
    *rays += b->probes != NULL ? ray_probes_end_rays(&w->probes, &w->h, lanes) : lanes;
    if (w->directed != NULL)
        directed_aim(w->directed, w->h.rays, step, lanes);
    embree_trace_and_find(b, context, w->h.rays, lanes, &w->h.found);
    if (w->directed != NULL)
        directed_weigh(w->directed, w->h.rays, &w->h.found, lanes);
    kept_rows_note(&w->rows, w->h.rays, step, &w->h.found);
    return lanes;
}

void gather_tile_run(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                     void *results, uint64_t *rays)
{
    struct gather_work *w = work;
    if (w->groups == NULL && kept_rows_replay(&w->rows, b, w->h.rays->batch, tile_run, results))
        return;
    const uint32_t steps = rays_begin(w->h.rays, b, tile_run, w->h.stream, 0);
    if (steps == 0) {
        (void)embree_group_run(b, tile_run);
        return;
    }
    hemisphere_clear(&w->h);
    memset(w->plain, 0, sizeof w->plain);
    if (w->groups != NULL)
        memset(w->groups, 0, w->h.rays->frame.count * group_sums(b) * sizeof *w->groups);
    if (w->guided != NULL)
        run_guide_begin(&w->guide, w->h.rays, b, w->guided, tile_run);
    if (b->probes != NULL)
        ray_probes_begin(&w->probes, &w->h, b, tile_run);
    if (w->directed != NULL)
        directed_begin(w->directed, w->h.rays, b, tile_run, w->h.stream);
    const bool plain = is_plain(w, b);
    const bool replays = kept_rows_read(&w->rows, b, tile_run, w->h.rays->frame.place, w->h.rays->frame.count),
               notes = kept_rows_note_chains(&w->rows);
    if (notes)
        kept_chains_begin(&w->rows.chains, w->h.rays->frame.count);
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = find_step(w, b, context, step, replays, rays);
        if (w->h.rays->frame.smooth && kept_rows_weighs(&w->rows))
            weigh(w, tile_run, step, lanes);
        if (replays && kept_rows_find_chains(&w->rows)) {
            collect_kept(b, w, step, lanes);
            continue;
        }
        if (b->probes != NULL || chain_any(b) || notes) {
            collect_lanes(b, context, w, step, lanes);
            continue;
        }
        hemisphere_count_lost(&w->h);
        if (plain)
            collect_plain(b, w, step, lanes);
        else
            collect(b, w, step);
    }
    if (plain)
        take_plain(w);
    if (b->probes != NULL)
        ray_probes_raise_to_zero(&w->h);
    if (replays && kept_rows_find_chains(&w->rows))
        take_lost(w);
    hemisphere_store(&w->h, results,
                     w->guided != NULL ? sizeof(struct kiln_guided_result) : sizeof(struct kiln_point_result));
    if (!replays)
        kept_rows_write(&w->rows, b, w->h.rays, tile_run, results);
    if (w->groups != NULL)
        store_groups(w, b, tile_run);
    if (w->guide.side > 0)
        run_guide_store(&w->guide, w->h.rays, results);
}

static int gather_create(void **work, const struct embree_backend *b, const void *parameters,
                         const struct kiln_batch *part, struct kiln_error *error)
{
    (void)parameters;
    int status = gather_work_create(work, b, part, error);
    if (status != KILN_OK)
        return status;
    status = kept_rows_create(&((struct gather_work *)*work)->rows, b, part, error);
    if (status == KILN_OK)
        status = groups_create(*work, b, error);
    if (status != KILN_OK)
        gather_work_destroy(work);
    return status;
}

int embree_gather(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                  uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {gather_create, gather_work_destroy, gather_tile_run,
                                              sizeof(struct kiln_point_result)};
    const int status = embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
    struct kiln_rows *rows = b->base.given.rows;
    return status == KILN_OK && rows != NULL && rows->status != KILN_OK
               ? kiln_fail(error, rows->status, "%s", rows->error.message)
               : status;
}
