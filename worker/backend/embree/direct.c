/* The direct pass: light from all sources at each point, by shadow rays. */
#include <math.h>
#include <omp.h>
#include <string.h>

#include "shaders/random.h"
#include "worker/backend/embree/embree.h"
#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/shadow.h"
#include "worker/base/memory.h"
#include "worker/sampling/sequence.h"

enum { SEQUENCES = 32 };

/* The samples of one choice of light, scrambled for the present tile; made as far as somebody has asked. */
struct sequence {
    uint32_t identity, made;
    bool used;
    uint32_t *points[KILN_DIMENSIONS];
};

/* A thread's working set. */
struct direct_work {
    struct fragment_frame frame;
    struct shadow_packet shadows;
    struct kiln_light_choice *choices;
    uint32_t *sobol[KILN_DIMENSIONS]; /* table_size points each */
    uint32_t table_size;
    struct sequence sequences[SEQUENCES]; /* by identity, direct mapped; the points of all tiles of a fragment choose alike */
    uint32_t *sequence_points;            /* what they are made of */
};

static void work_destroy(struct direct_work **work)
{
    if (*work == NULL)
        return;
    for (int d = 0; d < KILN_DIMENSIONS; d++)
        kiln_free(&(*work)->sobol[d]);
    kiln_free(&(*work)->choices);
    kiln_free(&(*work)->sequence_points);
    kiln_free(work);
}

static int work_create(struct direct_work **work, const struct embree_backend *b, uint32_t samples, struct kiln_error *error)
{
    int status = kiln_allocate(work, 1, sizeof **work, "the direct pass", error);
    if (status != KILN_OK)
        return status;
    struct direct_work *w = *work;
    w->table_size = samples + 1; /* a lone choice gets all samples, rounded up at most */
    status = kiln_allocate(&w->choices, KILN_CUT_MAX + b->params.lights->directional_count + 1, sizeof *w->choices, "the light choices", error);
    for (uint32_t d = 0; d < KILN_DIMENSIONS && status == KILN_OK; d++) {
        status = kiln_allocate(&w->sobol[d], w->table_size, sizeof(uint32_t), "the samples of a pass", error);
        for (uint32_t k = 0; status == KILN_OK && k < w->table_size; k++)
            w->sobol[d][k] = kiln_sobol(k, d);
    }
    if (status == KILN_OK)
        status = kiln_allocate(&w->sequence_points, (size_t)SEQUENCES * KILN_DIMENSIONS * w->table_size, sizeof(uint32_t), "the samples of a tile",
                               error);
    for (size_t i = 0; status == KILN_OK && i < SEQUENCES; i++)
        for (size_t d = 0; d < KILN_DIMENSIONS; d++)
            w->sequences[i].points[d] = w->sequence_points + (i * KILN_DIMENSIONS + d) * w->table_size;
    if (status != KILN_OK)
        work_destroy(work);
    return status;
}

/* The first `count` samples of the choice called `identity`. */
static const struct sequence *find_sequence(struct direct_work *w, uint32_t identity, uint32_t count)
{
    struct sequence *q = &w->sequences[identity % SEQUENCES];
    if (!q->used || q->identity != identity) {
        q->used = true;
        q->identity = identity;
        q->made = 0;
    }
    if (q->made < count) {
        const uint32_t seed = kiln_hash2(w->frame.tile_key, identity);
        for (uint32_t d = 0; d < KILN_DIMENSIONS; d++) {
            const uint32_t scramble = kiln_hash2(seed, d);
            for (uint32_t k = q->made; k < count; k++)
                q->points[d][k] = kiln_owen_scramble(w->sobol[d][k], scramble);
        }
        q->made = count;
    }
    return q;
}

/* The same point of the light, seen from where the ray starts. */
static void aim_from(struct kiln_light_sample *s, struct kiln_dvec3 place, struct kiln_dvec3 start)
{
    if (!isfinite(s->distance))
        return;
    const struct kiln_dvec3 to = dvec3_sub(dvec3_add(place, dvec3_scale(s->direction, s->distance)), start);
    const double distance = dvec3_length(to);
    if (!(distance > 0.0))
        return;
    s->direction = dvec3_scale(to, 1.0 / distance);
    s->distance = distance;
}

/* All samples of one choice at point j. */
static void sample_choice(struct direct_work *w, const struct embree_backend *b, struct RTCIntersectContext *context, uint32_t j,
                          const struct kiln_light_choice *choice, struct shadow_sums *sums, uint64_t *rays)
{
    struct fragment_frame *f = &w->frame;
    const uint32_t identity = kiln_hash2((uint32_t)choice->kind * 2u + 1u, choice->index);
    const struct kiln_dvec3 normal0 = dvec3((double)f->normal[0][j], (double)f->normal[1][j], (double)f->normal[2][j]);
    const uint32_t strategies = kiln_lights_strategies(b->params.lights, choice, normal0);
    const struct sequence *sequence[2];
    uint32_t shift[2][KILN_DIMENSIONS];
    for (uint32_t i = 0; i < strategies; i++) {
        sequence[i] = find_sequence(w, identity + i, (choice->samples + strategies - 1) / strategies);
        for (uint32_t d = 0; d < KILN_DIMENSIONS; d++)
            shift[i][d] = kiln_hash2(kiln_hash2(f->key[j], identity + i), d);
    }
    shadow_begin(&w->shadows, sums, choice->samples);
    for (uint32_t i = 0; i < choice->samples; i++) {
        const uint32_t strategy = i % strategies;
        double random[KILN_DIMENSIONS];
        for (uint32_t d = 0; d < KILN_DIMENSIONS; d++)
            random[d] = kiln_unit_double(sequence[strategy]->points[d][i / strategies] ^ shift[strategy][d]);
        struct kiln_vec3 p, n;
        const float offset = frame_position(f, b, j, (float)random[KILN_DIMENSION_S], (float)random[KILN_DIMENSION_T], &p, &n);
        struct kiln_light_sample s;
        const struct kiln_dvec3 normal = dvec3_of(n), place = dvec3_sub(dvec3_of(p), dvec3_scale(normal, (double)offset));
        if (!kiln_lights_sample(b->params.lights, choice, i, place, normal, random[KILN_DIMENSION_CHOICE],
                                random[KILN_DIMENSION_U], random[KILN_DIMENSION_V], &s))
            continue;
        const double cosine = dvec3_dot(normal, s.direction);
        if (!(cosine > 0.0))
            continue;
        const double shading_cosine = f->smooth ? fmax(0.0, dvec3_dot(dvec3_of(frame_shading(f, j, n)), s.direction)) : cosine;
        aim_from(&s, place, dvec3_of(p));
        shadow_add(&w->shadows, b, context, p, &s, i, cosine, shading_cosine);
        (*rays)++;
    }
    shadow_end(&w->shadows, b, context);
}

static void direct_point(struct direct_work *w, const struct embree_backend *b, struct RTCIntersectContext *context, uint32_t j,
                         uint32_t samples, struct kiln_point_result *result, uint64_t *rays)
{
    const struct fragment_frame *f = &w->frame;
    const struct kiln_dvec3 normal = f->extent[j].one_normal ? dvec3((double)f->normal[0][j], (double)f->normal[1][j], (double)f->normal[2][j])
                                                      : dvec3(0.0, 0.0, 0.0);
    const size_t limit = samples / 2 < 1 ? 1 : samples / 2 < KILN_CUT_MAX ? samples / 2 : KILN_CUT_MAX;
    const size_t count = kiln_lights_choices(b->params.lights, dvec3_of(f->extent[j].centre), (double)f->extent[j].spread, normal, limit, w->choices);
    (void)kiln_lights_allot(w->choices, count, samples);
    double incident[3] = {0}, irradiance[3] = {0}, variance = 0.0;
    for (size_t i = 0; i < count; i++) {
        struct shadow_sums sums = {0};
        sample_choice(w, b, context, j, &w->choices[i], &sums, rays);
        const double scale = 1.0 / (double)w->choices[i].samples;
        for (int c = 0; c < 3; c++) {
            incident[c] += sums.incident[c] * scale;
            irradiance[c] += sums.irradiance[c] * scale;
        }
        variance += shadow_variance(&sums, w->choices[i].samples);
    }
    for (int c = 0; c < 3; c++) {
        result->incident[c] = (float)incident[c];
        result->irradiance[c] = (float)irradiance[c];
    }
    result->error = (float)sqrt(variance);
    result->present = f->present[j];
}

static int direct_part(struct embree_backend *b, size_t fragment_first, size_t fragment_count, uint32_t samples, uint32_t stream,
                       struct kiln_point_result *batch_results, uint64_t *rays, struct kiln_error *error)
{
    (void)stream;
    const uint64_t base = b->surface->fragments[fragment_first].first;
    uint64_t traced = 0;
    int status = KILN_OK;
#pragma omp parallel num_threads((int)b->threads) reduction(+ : traced)
    {
        struct direct_work *w = NULL;
        struct kiln_error own;
        const int created = work_create(&w, b, samples, &own);
        if (created != KILN_OK) {
#pragma omp critical(kiln_direct_status)
            status = kiln_fail(error, created, "%s", own.message);
        }
#pragma omp barrier
        const unsigned saved = embree_enter();
        struct RTCIntersectContext context;
        embree_context(b, &context);
#pragma omp for schedule(dynamic, 4)
        for (size_t i = 0; i < fragment_count; i++) {
            if (status != KILN_OK)
                continue;
            const size_t fragment = fragment_first + i;
            struct kiln_point_result *results = batch_results + (b->surface->fragments[fragment].first - base);
            memset(results, 0, b->surface->fragments[fragment].count * sizeof *results);
            frame_build(&w->frame, b, fragment, FRAME_EXTENT);
            for (int q = 0; q < SEQUENCES; q++)
                w->sequences[q].used = false;
            for (uint32_t j = 0; j < w->frame.count; j++)
                direct_point(w, b, &context, j, samples, &results[w->frame.place[j]], &traced);
        }
        embree_leave(saved);
        work_destroy(&w);
    }
    *rays += traced;
    return status;
}

int embree_direct(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint64_t *rays,
                  struct kiln_error *error)
{
    return embree_in_parts((struct embree_backend *)backend, batch, samples, 0, direct_part, rays, error);
}
