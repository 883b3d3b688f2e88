/* Checks of any implementation of scattering functions: nothing is lost in a white furnace, draws agree with densities,
 * densities integrate to 1, values are the same both ways. They take ALPHAS roughnesses and ANGLES angles; `thin`:
 * every third. The implementation is asked many questions at once. Include after cmocka.h. */
#ifndef KILN_TESTS_UNIT_BSDF_CHECKS_H
#define KILN_TESTS_UNIT_BSDF_CHECKS_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "shaders/shared/bsdf.h"
#include "shaders/shared/random.h"
#include "tests/unit/bsdf_cells.h"
#include "tests/unit/bsdf_materials.h"
#include "worker/material/brushed.h"
#include "worker/sampling/sequence.h"

/* A direction i is drawn by three random numbers in (0, 1), or given. */
struct lobes_query {
    struct kiln_vec3 o, i;
    float pick, u, v;
    uint32_t lobes;        /* which of those that are given along */
    uint32_t which, mode;  /* KILN_LOBE_..., KILN_RADIANCE or KILN_IMPORTANCE */
    uint32_t draws, turns; /* 1: i is drawn; the density of the way back is wanted */
};

/* As struct kiln_bsdf_drawn where i is drawn: `value` is the weight; else as struct kiln_bsdf_value. */
struct lobes_answer {
    struct kiln_vec3 i, value;
    float density, backward;
    uint32_t delta;
};

struct lobes_source {
    void (*ask)(void *context, const struct kiln_bsdf_lobes *lobes, size_t lobes_count,
                const struct lobes_query *queries, size_t count, struct lobes_answer *answers);
    void *context;
    bool thin;
};

/* ---- what is asked ---- */

/* Questions about some lobes, and their answers. */
struct lobes_batch {
    const struct lobes_source *source;
    struct kiln_bsdf_lobes lobes[ALPHAS];
    size_t lobes_count, count, room;
    struct lobes_query *queries;
    struct lobes_answer *answers;
    struct kiln_brushed_table *tables[ALPHAS]; /* those that lobes use; NULL: none */
};

/* Tables of a material as if its roughness had a texture with all values. They take seconds, so all that were made are
 * kept: each check asks for them anew. */
struct textured {
    struct textured *next;
    const struct material *material;
    float index;
    struct kiln_brushed_table stack[KILN_BRUSHED_LAYERS];
    struct kiln_bsdf_trapped_table trapped;
    struct kiln_bsdf_tables tables;
};
static inline struct kiln_bsdf_tables textured_tables(const struct material *m, struct kiln_bsdf p)
{
    static struct textured *all;
    for (const struct textured *t = all; t != NULL; t = t->next)
        if (t->material == m && t->index == p.eta.y)
            return t->tables;
    struct textured *made = calloc(1, sizeof *made);
    assert_non_null(made);
    *made = (struct textured){.next = all, .material = m, .index = p.eta.y};
    all = made;
    const float coat = sqrtf(p.coat_alpha);
    const void *table = m->anisotropy > 0.0f ? (const void *)made->stack : &made->trapped;
    const uint32_t low = (uint32_t)(uintptr_t)table, high = (uint32_t)((uint64_t)(uintptr_t)table >> 32);
    if (m->anisotropy > 0.0f) {
        kiln_brushed_stack(made->stack, &p, m->anisotropy,
                           (struct kiln_layers){0.0f, KILN_BRUSHED_LAYERS - 1, KILN_BRUSHED_LAYERS});
        made->tables.brushed_low = low;
        made->tables.brushed_high = high;
    } else {
        kiln_bsdf_trapped_tabulate(&made->trapped, &p, kiln_layers_of(0.0f, 1.0f, KILN_BSDF_TRAPPED_LAYERS - 1),
                                   m->coat_varies ? kiln_layers_of(0.0f, 1.0f, KILN_BSDF_TRAPPED_COATS - 1)
                                                  : kiln_layers_of(coat, coat, KILN_BSDF_TRAPPED_COATS - 1));
        made->tables.trapped_low = low;
        made->tables.trapped_high = high;
    }
    return made->tables;
}

/* The table of lobes with brushed facets; likewise kept. */
static inline const struct kiln_brushed_table *brushed_table(const struct kiln_bsdf_lobes *lobes)
{
    struct brushed {
        struct brushed *next;
        struct kiln_bsdf_lobes lobes;
        struct kiln_brushed_table table;
    };
    static struct brushed *all;
    for (const struct brushed *b = all; b != NULL; b = b->next)
        if (kiln_brushed_same(&b->lobes, lobes))
            return &b->table;
    struct brushed *made = malloc(sizeof *made);
    assert_non_null(made);
    made->next = all;
    made->lobes = *lobes;
    kiln_brushed_tabulate(&made->table, lobes);
    all = made;
    return &made->table;
}

/* Lobes number `at` of the batch: those of a material. */
static inline void batch_prepare(struct lobes_batch *b, size_t at, const struct material *m, struct kiln_bsdf p)
{
    if (m->textured) {
        b->lobes[at] = kiln_bsdf_prepare_hit(p, textured_tables(m, p));
        return;
    }
    b->lobes[at] = kiln_bsdf_prepare(p);
    if (!kiln_brushed_wanted(&b->lobes[at]))
        return;
    b->tables[at] = malloc(sizeof *b->tables[at]);
    assert_non_null(b->tables[at]);
    *b->tables[at] = *brushed_table(&b->lobes[at]);
    kiln_brushed_use(&b->lobes[at], b->tables[at]);
}

static inline struct lobes_query *batch_add(struct lobes_batch *b, uint32_t lobes, struct kiln_vec3 o)
{
    if (b->count == b->room) {
        b->room = 2 * b->room + 4096;
        b->queries = realloc(b->queries, b->room * sizeof *b->queries);
        assert_non_null(b->queries);
    }
    b->queries[b->count] = (struct lobes_query){.o = o, .lobes = lobes, .which = KILN_LOBE_ALL};
    return &b->queries[b->count++];
}

/* Random numbers of draw k: points of Sobol's sequence, Owen-scrambled, or independent ones. */
enum numbers { EVEN, INDEPENDENT };
enum { EVEN_MOST = 4096 };
static inline const float *even_numbers(uint32_t k)
{
    static float points[EVEN_MOST][3];
    assert_true(k < EVEN_MOST);
    if (points[k][0] == 0.0f)
        for (uint32_t c = 0; c < 3; c++)
            points[k][c] = kiln_unit_float(kiln_owen_scramble(kiln_sobol(k, c), kiln_hash1(c)));
    return points[k];
}
static inline void batch_draw(struct lobes_batch *b, uint32_t lobes, struct kiln_vec3 o, uint32_t k,
                              enum numbers numbers)
{
    struct lobes_query *q = batch_add(b, lobes, o);
    float p[3];
    for (uint32_t c = 0; c < 3; c++)
        p[c] = numbers == EVEN ? even_numbers(k)[c] : kiln_unit_float(kiln_hash1(3 * k + c));
    q->pick = p[0];
    q->u = p[1];
    q->v = p[2];
    q->mode = KILN_IMPORTANCE;
    q->draws = 1;
}

static inline void batch_ask(struct lobes_batch *b)
{
    b->answers = realloc(b->answers, (b->count + 1) * sizeof *b->answers);
    assert_non_null(b->answers);
    b->source->ask(b->source->context, b->lobes, b->lobes_count, b->queries, b->count, b->answers);
}

static inline void batch_end(struct lobes_batch *b)
{
    free(b->queries);
    free(b->answers);
    for (int i = 0; i < ALPHAS; i++)
        free(b->tables[i]);
    *b = (struct lobes_batch){0};
}

/* The next of ALPHAS and of ANGLES to be looked at. Coats take long. */
static inline int next_alpha(const struct lobes_source *s, const struct material *m, int i)
{
    return i + (s->thin || m->coat > 0.0f ? 3 : 1);
}
static inline int next_angle(const struct lobes_source *s, int i) { return i + (s->thin ? 3 : 1); }

/* ---- a white furnace ---- */

/* Azimuths of light, from the tangent on; of what is the same about the normal the first is enough. */
enum { AZIMUTHS = 5 };
static const float azimuths[AZIMUTHS] = {0.3f, 0.0f, 0.75f, 1.2f, 1.5707964f};

static inline int azimuths_of(const struct material *m) { return m->anisotropy > 0.0f ? AZIMUTHS : 1; }
/* Layers take the azimuth as their tables do, of which all are looked at. */
static inline int next_azimuth(const struct material *m, int a) { return a + (m->textured ? AZIMUTHS - 1 : 1); }

/* Least and largest share of the light from all angles that is sent on. */
static inline void furnace_of(const struct lobes_source *s, const struct material *m, float alpha, double range[2])
{
    struct lobes_batch b = {.source = s, .lobes_count = 1};
    const uint32_t draws = alpha < 0.02f && m->coat == 0.0f && m->anisotropy == 0.0f ? 1024 : 4096;
    batch_prepare(&b, 0, m, white_material(m, alpha));
    for (int a = 0; a < azimuths_of(m); a = next_azimuth(m, a))
        for (int j = 0; j < ANGLES; j = next_angle(s, j))
            for (uint32_t k = 0; k < draws && (a == 0 || degrees[j] > 0.0f); k++) /* the normal has no azimuth */
                batch_draw(&b, 0, direction(degrees[j], azimuths[a], m->behind), k, EVEN);
    batch_ask(&b);
    for (size_t at = 0; at < b.count; at += draws) {
        double sum = 0.0;
        for (uint32_t k = 0; k < draws; k++) {
            const double weight = (double)b.answers[at + k].value.y;
            assert_true(weight >= 0.0 && weight < 1e6);
            sum += weight;
        }
        range[0] = fmin(range[0], sum / draws);
        range[1] = fmax(range[1], sum / draws);
    }
    batch_end(&b);
}

static inline void check_furnaces(const struct lobes_source *s)
{
    for (size_t i = 0; i < MATERIALS; i++) {
        double range[2] = {2.0, 0.0};
        for (int a = 0; a < ALPHAS; a += s->thin ? 3 : 1)
            furnace_of(s, &materials[i], alphas[a], range);
        print_message("%s: %.4f to %.4f\n", materials[i].name, range[0], range[1]);
        assert_true(range[0] >= (double)materials[i].darkest && range[1] <= (double)materials[i].brightest);
    }
}

/* ---- draws against densities ---- */

/* Densities are asked for in the order in which cells_expect wants them: first it gets zeros, then the answers. */
struct densities {
    struct lobes_batch *batch;
    struct kiln_vec3 o;
    size_t next;
    bool known;
};

static inline double density_in_turn(void *context, struct kiln_vec3 i)
{
    struct densities *d = context;
    if (d->known)
        return (double)d->batch->answers[d->next++].density;
    batch_add(d->batch, 0, d->o)->i = i;
    return 0.0;
}

static inline struct fit test_angle(const struct lobes_source *s, const struct material *m, float alpha, float angle)
{
    struct lobes_batch b = {.source = s, .lobes_count = 1};
    batch_prepare(&b, 0, m, white_material(m, alpha));
    struct densities densities = {.batch = &b, .o = direction(angle, 0.3f, m->behind)};
    struct cells cells;
    cells_place(&cells, &b.lobes[0], alpha, densities.o);
    for (uint32_t k = 1; k <= DRAWS; k++)
        batch_draw(&b, 0, densities.o, k, INDEPENDENT);
    cells_expect(&cells, (double)densities.o.z, density_in_turn, &densities);
    batch_ask(&b);
    densities.known = true;
    densities.next = DRAWS;
    cells_expect(&cells, (double)densities.o.z, density_in_turn, &densities);
    for (size_t k = 0; k < DRAWS; k++)
        cells_count(&cells, b.answers[k].i, b.answers[k].density > 0.0f);
    batch_end(&b);
    return cells_judge(&cells);
}

static inline void check_draws(const struct lobes_source *s)
{
    for (size_t i = 0; i < MATERIALS; i++) {
        if (!materials[i].draws)
            continue;
        double worst = 0.0, off = 0.0;
        const bool narrow = materials[i].anisotropy > 0.0f; /* lobes too narrow across for the cells, at first */
        for (int a = narrow ? ALPHAS / 2 : 0; a < ALPHAS; a = next_alpha(s, &materials[i], a))
            for (int j = 0; j < ANGLES; j = next_angle(s, j)) {
                const struct fit fit = test_angle(s, &materials[i], alphas[a], degrees[j]);
                worst = fmax(worst, fit.deviations);
                off = fmax(off, fabs(fit.total - 1.0));
            }
        print_message("%s: chi-squared at most %.1f deviations up, density off 1 by %.4f\n", materials[i].name, worst,
                      off);
        assert_true(worst < 5.0);
        assert_true(off < 0.02);
    }
}

/* ---- reciprocity, and densities both ways ---- */

/* Asks for i from o and for o from i, both ways. */
enum { ON, BACK, BACK_RADIANCE, DRAWN, WAYS };
static inline void batch_ways(struct lobes_batch *b, uint32_t lobes, struct kiln_vec3 o, struct kiln_vec3 i)
{
    for (int way = 0; way < WAYS; way++) {
        const bool back = way == BACK || way == BACK_RADIANCE;
        struct lobes_query *q = batch_add(b, lobes, back ? i : o);
        q->i = back ? o : i;
        q->mode = way == BACK || way == DRAWN ? KILN_IMPORTANCE : KILN_RADIANCE;
    }
}

/* f(o, i) of radiance is f(i, o) of importance; over the squared indices both are one. By how much that is off. */
static inline double reciprocity(const struct kiln_bsdf_lobes *l, struct kiln_vec3 o, const struct lobes_answer *d,
                                 const struct lobes_answer ways[WAYS])
{
    const double there = fabs((double)d->i.z), here = fabs((double)o.z);
    const bool crosses = o.z * d->i.z < 0.0f && l->p.thin_wall == 0u;
    double off = 0.0;
    for (int c = 0; c < 3; c++) {
        const double eta = crosses ? (double)(&l->p.eta.x)[c] : 1.0,
                     squared = o.z > 0.0f ? eta * eta : 1.0 / (eta * eta);
        const double f = (double)(&ways[ON].value.x)[c] / there, g = (double)(&ways[BACK].value.x)[c] / here;
        off = fmax(off, fmax(apart(f, g), apart(f * squared, (double)(&ways[BACK_RADIANCE].value.x)[c] / here)));
        assert_true(apart((double)((&d->value.x)[c] * d->density), (double)(&ways[DRAWN].value.x)[c]) < 1e-5);
    }
    assert_true(apart((double)d->density, (double)ways[ON].density) < 1e-5);
    assert_true(apart((double)d->backward, (double)ways[BACK].density) < 1e-5);
    return off;
}

/* The largest over draws from some angles, of lobes that the batch has; draws of mirrors have no value. */
static inline double reciprocity_of(struct lobes_batch *b)
{
    struct lobes_batch both = {.source = b->source, .lobes_count = b->lobes_count};
    double off = 0.0;
    size_t way = 0;
    memcpy(both.lobes, b->lobes, sizeof b->lobes);
    for (size_t k = 0; k < b->count; k++)
        b->queries[k].turns = 1;
    batch_ask(b);
    for (size_t k = 0; k < b->count; k++)
        if (b->answers[k].density > 0.0f && b->answers[k].delta == 0u)
            batch_ways(&both, b->queries[k].lobes, b->queries[k].o, b->answers[k].i);
    batch_ask(&both);
    for (size_t k = 0; k < b->count; k++)
        if (b->answers[k].density > 0.0f && b->answers[k].delta == 0u) {
            off = fmax(
                off, reciprocity(&b->lobes[b->queries[k].lobes], b->queries[k].o, &b->answers[k], &both.answers[way]));
            way += WAYS;
        }
    assert_true(way == both.count);
    batch_end(&both);
    return off;
}

static inline void check_reciprocities(const struct lobes_source *s)
{
    for (size_t i = 0; i < MATERIALS; i++) {
        struct lobes_batch b = {.source = s, .lobes_count = ALPHAS};
        for (int a = 0; a < ALPHAS; a += s->thin ? 3 : 1) {
            batch_prepare(&b, (size_t)a, &materials[i], colored_material(&materials[i], alphas[a]));
            for (int j = 0; j < ANGLES; j = next_angle(s, j))
                for (uint32_t k = 1; k <= 64; k++)
                    batch_draw(&b, (uint32_t)a, direction(degrees[j], 0.3f, materials[i].behind), k, EVEN);
        }
        const double off = reciprocity_of(&b);
        batch_end(&b);
        print_message("%s: reciprocity to %.1e\n", materials[i].name, off);
        assert_true(off < 1e-5);
    }
}

#endif
