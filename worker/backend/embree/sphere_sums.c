#include "worker/backend/embree/sphere_sums.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/clones.h"
#include "worker/base/memory.h"

enum { STRETCH = 32 };                    /* spheres whose sums fit a core's cache */
enum { LANES = KILN_SPHERE_WEIGHTS + 1 }; /* a weight of zero more */
enum { AHEAD = 8 };                       /* prefetch distance, chords */
#define SUM_MOST 0x1p61                   /* of one chord, in units: limit of the conversion to an integer */
#define WEIGHT_MOST 2.0                   /* more than any weight */
#define SMALL 0x1p50                      /* limit of integers that adding ROUND can round */
#define ROUND 6755399441055744.0          /* 1.5 x 2^52: adding it rounds to an integer, half to even, as llrint */

/* Sums of a sphere, by colour. */
struct sums {
    int64_t of[3][LANES];
};

int sphere_chords_begin(struct sphere_chords *c, const struct kiln_probe_spheres *s, struct kiln_error *error)
{
    *c = (struct sphere_chords){.status = KILN_OK};
    return kiln_arena_allocate(&c->arena, &c->last, s->count, sizeof *c->last, "the chords of light paths", error);
}

void sphere_chords_release(struct sphere_chords *c)
{
    kiln_free(&c->begin);
    kiln_arena_release(&c->arena);
}

void sphere_chords_add(struct sphere_chords *c, const struct sphere_chord *chord)
{
    if (c->status == KILN_OK && c->count == c->room)
        c->status = kiln_arena_grow(&c->arena, &c->chords, &c->room, c->count + 1, sizeof *c->chords,
                                    "the chords of light paths", &c->error);
    if (c->status == KILN_OK)
        c->chords[c->count++] = *chord;
}

/* ---- moments ---- */

static void give_moments(struct sphere_chords *c, const struct kiln_probe_spheres *s)
{
    if (c->moments == 0)
        return;
#pragma omp atomic
    s->moments[c->aim] += c->moments;
    c->moments = 0;
}

void sphere_chords_note(struct sphere_chords *c, const struct kiln_probe_spheres *s, size_t aim, uint64_t moment)
{
    if (aim != c->aim)
        give_moments(c, s);
    c->aim = aim;
    c->moments += moment;
}

/* ---- sums ---- */

size_t sphere_stretches(const struct kiln_probe_spheres *s) { return (s->count + STRETCH - 1) / STRETCH; }

void sphere_chords_end(struct sphere_chords *c, const struct kiln_probe_spheres *s)
{
    const size_t stretches = sphere_stretches(s);
    give_moments(c, s);
    if (c->status == KILN_OK)
        c->status = kiln_allocate(&c->begin, stretches + 2, sizeof *c->begin, "the chords of light paths", &c->error);
    if (c->status == KILN_OK)
        c->status = kiln_arena_allocate(&c->arena, &c->order, c->count, sizeof *c->order, "the chords of light paths",
                                        &c->error);
    if (c->status != KILN_OK)
        return;
    for (size_t i = 0; i < c->count; i++)
        c->begin[c->chords[i].sphere / STRETCH + 2]++;
    for (size_t i = 2; i <= stretches + 1; i++)
        c->begin[i] += c->begin[i - 1];
    for (size_t i = 0; i < c->count; i++)
        c->order[c->begin[c->chords[i].sphere / STRETCH + 1]++] = (uint32_t)i;
}

/* Adds a chord's light of one colour times the weights, in integer units. */
KILN_CLONES static void add_colour(double brought, const double *restrict weights, double unit, int64_t *restrict sums)
{
    union {
        double real[LANES];
        int64_t bits[LANES];
    } values;
    const union {
        double real;
        int64_t bits;
    } round = {ROUND};
    for (int k = 0; k < LANES; k++)
        values.real[k] = brought * weights[k] / unit + round.real;
    for (int k = 0; k < LANES; k++)
        sums[k] += values.bits[k] - round.bits;
}

/* The same of any number. */
static void add_large(double brought, const double *weights, double unit, int64_t *sums)
{
    for (int k = 0; k < LANES; k++)
        sums[k] += llrint(fmax(-SUM_MOST, fmin(brought * weights[k] / unit, SUM_MOST)));
}

static void add_chord(const struct sphere_chord *chord, double unit, struct sums *sums)
{
    double weights[LANES] = {0.0};
    spheres_weights(dvec3_scale(dvec3_of(chord->direction), -1.0), weights);
    for (int c = 0; c < 3; c++)
        (WEIGHT_MOST * fabs(chord->brought[c]) < SMALL * unit ? add_colour : add_large)(chord->brought[c], weights,
                                                                                        unit, sums->of[c]);
}

/* Adds a thread's chords in a range of spheres to their sums, and records which spheres these are. */
static void add_chords(const struct sphere_chords *c, size_t stretch, double unit, struct sums sums[STRETCH],
                       uint64_t *met)
{
    const uint32_t *order = c->order, end = c->begin[stretch + 1];
    for (uint32_t i = c->begin[stretch]; i < end; i++) {
        const struct sphere_chord *chord = &c->chords[order[i]];
        const size_t sphere = chord->sphere - stretch * STRETCH;
        if (i + AHEAD < end)
            __builtin_prefetch(&c->chords[order[i + AHEAD]]);
        if ((*met >> sphere & 1) == 0)
            memset(&sums[sphere], 0, sizeof sums[sphere]);
        *met |= (uint64_t)1 << sphere;
        add_chord(chord, unit, &sums[sphere]);
    }
}

void sphere_stretch_add(const struct kiln_probe_spheres *s, const struct sphere_chords *threads, size_t count,
                        size_t stretch)
{
    struct sums sums[STRETCH];
    uint64_t met = 0;
    for (size_t t = 0; t < count; t++)
        add_chords(&threads[t], stretch, s->unit, sums, &met);
    for (size_t sphere = 0; sphere < STRETCH; sphere++)
        for (int i = 0; i < KILN_SPHERE_SUMS && (met >> sphere & 1) != 0; i++)
            s->sums[KILN_SPHERE_SUMS * (stretch * STRETCH + sphere) + (size_t)i] +=
                (uint64_t)sums[sphere].of[i % 3][i / 3];
}
