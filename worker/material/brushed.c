#include "worker/material/brushed.h"

#include <math.h>
#include <string.h>

/* What is given back of what is lost is a little less, so that a furnace is hardly ever too bright: between its points
 * a table says up to so much too much. */
#define WHOLE_LESS 0.0008
#define THIN_LESS 0.0025
#define DENSE_LESS 0.0045
#define HELD_LESS 0.0025
#define COAT_LESS 0.0006
#define FRESNEL_MORE 0.0006 /* the matt layer gets what is not reflected */

/* Facets of a direction: a lattice of Fibonacci numbers. */
enum { FACETS = 987, FACETS_BEFORE = 610, FEW_FACETS = 377, FEW_FACETS_BEFORE = 233 };
enum { BALANCINGS = 4 };
/* The directions of means: equal parts of the squared cosine and of a quarter turn. */
enum { RINGS = 48, SECTORS = 48 };

bool kiln_brushed_wanted(const struct kiln_bsdf_lobes *l)
{
    return l->p.model == KILN_BSDF_LAYERS && l->base_is_mirror == 0 && l->alpha_x != l->alpha_y;
}

static bool is_glass(const struct kiln_bsdf_lobes *l) { return l->glass > 0.0f && l->p.thin_wall == 0; }

bool kiln_brushed_same(const struct kiln_bsdf_lobes *a, const struct kiln_bsdf_lobes *b)
{
    const bool coats = a->coat.strength > 0.0f || b->coat.strength > 0.0f;
    if (a->alpha_x != b->alpha_x || a->alpha_y != b->alpha_y || a->p.eta.y != b->p.eta.y ||
        a->p.thin_wall != b->p.thin_wall || a->metal != b->metal || a->glass != b->glass)
        return false;
    return !coats || (a->holds == b->holds && a->coat.strength == b->coat.strength &&
                      a->p.coat_alpha == b->p.coat_alpha && a->coat_is_mirror == b->coat_is_mirror);
}

const struct kiln_brushed_table *kiln_brushed_of(const struct kiln_bsdf_lobes *l)
{
    return (const struct kiln_brushed_table *)(uintptr_t)((uint64_t)l->brushed_high << 32 | l->brushed_low);
}

void kiln_brushed_move(struct kiln_bsdf_lobes *l, uint64_t address)
{
    l->brushed_low = (uint32_t)address;
    l->brushed_high = (uint32_t)(address >> 32);
}

/* ---- what facets do with light from one direction ---- */

struct tally {
    double whole, reflected, thin, dense, sent; /* means over facets; `sent`: from behind a coat */
};

/* G2 / G1 of a direction on either side; `own` is the stretch of the one that light comes from, over its cosine. */
static double seen(const struct kiln_bsdf_lobes *l, double own, struct kiln_vec3 i)
{
    return (1.0 + own) / (own + (double)(kiln_ggx_stretch(i, l->alpha_x, l->alpha_y) / fabsf(i.z)));
}

/* What goes through the facet h, into a medium `eta` times as dense. */
static double through(const struct kiln_bsdf_lobes *l, struct kiln_vec3 o, struct kiln_vec3 h, double own, float eta,
                      double reflected)
{
    const float cosine = vec3_dot(o, h), behind = kiln_refracted_cosine(cosine, eta);
    if (!(reflected < 1.0))
        return 0.0;
    const struct kiln_vec3 i = kiln_refracted(o, h, 1.0f / eta, cosine, behind);
    return i.z < 0.0f ? (1.0 - reflected) * seen(l, own, i) : 0.0;
}

static void add_facet(struct tally *t, const struct kiln_bsdf_lobes *l, struct kiln_vec3 o, struct kiln_vec3 h)
{
    const float cosine = vec3_dot(o, h), index = l->face.index;
    const struct kiln_vec3 i = kiln_reflected(o, h);
    const double own = (double)(kiln_ggx_stretch(o, l->alpha_x, l->alpha_y) / o.z);
    const double thin = (double)kiln_fresnel(cosine, index), dense = (double)kiln_fresnel(cosine, 1.0f / index);
    const double share = i.z > 0.0f ? seen(l, own, i) : 0.0;
    t->whole += share / FACETS;
    t->reflected += share * thin / FACETS;
    if (!is_glass(l))
        return;
    t->thin += (share * thin + through(l, o, h, own, index, thin)) / FACETS;
    t->dense += (share * dense + through(l, o, h, own, 1.0f / index, dense)) / FACETS;
    if (l->holds != 0)
        t->sent += (double)kiln_bsdf_sent_behind(*l, o, h) / FACETS;
}

/* Facet j of `count` that o sees; count and `before` are neighbours among Fibonacci's numbers. */
static struct kiln_vec3 facet(const struct kiln_bsdf_lobes *l, struct kiln_vec3 o, int j, int count, int before)
{
    const float u = ((float)(j * before % count) + 0.5f) / (float)count, v = ((float)j + 0.5f) / (float)count;
    return kiln_ggx_sample(o, l->alpha_x, l->alpha_y, u, v);
}

static void tabulate(float at[KILN_BRUSHED_VALUES], const struct kiln_bsdf_lobes *l, struct kiln_vec3 o)
{
    struct tally t = {0.0, 0.0, 0.0, 0.0, 0.0};
    for (int j = 0; j < FACETS; j++)
        add_facet(&t, l, o, facet(l, o, j, FACETS, FACETS_BEFORE));
    const double bare = l->p.eta.y < 1.0f ? t.thin : t.dense; /* from behind, were there no coat */
    at[KILN_BRUSHED_WHOLE] = (float)fmax(1.0 - WHOLE_LESS - t.whole, 0.0);
    at[KILN_BRUSHED_FRESNEL] = (float)(t.whole > 0.0 ? fmin(t.reflected / t.whole + FRESNEL_MORE, 1.0) : 1.0);
    at[KILN_BRUSHED_THIN] = (float)fmax(1.0 - THIN_LESS - t.thin, 0.0);
    at[KILN_BRUSHED_DENSE] = (float)fmax(1.0 - DENSE_LESS - t.dense, 0.0);
    at[KILN_BRUSHED_HELD] = l->holds != 0 ? (float)fmax(bare - t.sent - HELD_LESS, 0.0) : 0.0f;
    at[KILN_BRUSHED_COAT] = l->coat.strength > 0.0f ? kiln_coat_factor(l->coat, o.z) : 1.0f;
}

/* The direction of a table's point. */
static struct kiln_vec3 point_direction(const struct kiln_brushed_table *table, const struct kiln_bsdf_lobes *l, int at)
{
    const float t = kiln_brushed_t((float)(at / KILN_BRUSHED_U), table->corner);
    const float u = (float)(at % KILN_BRUSHED_U) / (float)(KILN_BRUSHED_U - 1);
    const float across = fmaxf(t * t, 1e-4f), mu = fmaxf(u * u, 1e-4f); /* no facet is seen edge on */
    const float smooth = sqrtf((1.0f - across) * (1.0f + across)), rough = across * sqrtf((1.0f - mu) * (1.0f + mu));
    const bool turned = l->alpha_x < l->alpha_y;
    return vec3(turned ? smooth : rough, turned ? rough : smooth, across * mu);
}

/* ---- directions ---- */

static struct kiln_vec3 direction_of(float mu, int sector)
{
    const float turn = 0.5f * (float)KILN_PI * ((float)sector + 0.5f) / (float)SECTORS;
    const float r = sqrtf((1.0f - mu) * (1.0f + mu));
    return vec3(r * cosf(turn), r * sinf(turn), mu);
}

/* ---- under a coat ---- */

/* What the base sends on to its front: shares of which all light is reflected, and of which facets reflect as glass. */
struct base {
    double all, partial;
};

static struct base base_of(const struct kiln_bsdf_lobes *l)
{
    const struct base s = {(double)(l->metal + (l->p.thin_wall != 0 ? l->glass : 0.0f)),
                           is_glass(l) ? (double)l->glass : 0.0};
    return s.all + s.partial > 0.0 ? s : (struct base){0.0, 1.0};
}

/* What facets reflect of light from o, without the coat's factor of where it goes and with it. */
static void reflect(const struct kiln_bsdf_lobes *l, struct base base, struct kiln_vec3 o, double *without,
                    double *with)
{
    const double own = (double)(kiln_ggx_stretch(o, l->alpha_x, l->alpha_y) / o.z);
    *without = 0.0;
    *with = 0.0;
    for (int j = 0; j < FEW_FACETS; j++) {
        const struct kiln_vec3 h = facet(l, o, j, FEW_FACETS, FEW_FACETS_BEFORE), i = kiln_reflected(o, h);
        if (!(i.z > 0.0f))
            continue;
        const double fresnel = (double)kiln_fresnel(vec3_dot(o, h), l->face.index);
        const double share = (base.all + base.partial * fresnel) * seen(l, own, i) / FEW_FACETS;
        *without += share;
        *with += share * (double)kiln_bsdf_coat_factor(*l, true, i);
    }
}

/* What the coat's factor takes of light that facets give back: the mean of it by what they lose. */
static double given_back_by(const struct kiln_bsdf_lobes *l)
{
    double lost = 0.0, sent = 0.0;
    for (int k = 0; k < RINGS * SECTORS; k++) {
        const struct kiln_vec3 w = direction_of(sqrtf(((float)(k / SECTORS) + 0.5f) / (float)RINGS), k % SECTORS);
        const double facets = (double)kiln_bsdf_facets_lost(*l, w);
        lost += facets;
        sent += facets * (double)kiln_bsdf_coat_factor(*l, true, w);
    }
    return lost > 0.0 ? sent / lost : 1.0;
}

/* Finds the coat's factor h, with which a white base sends on what the coat lets in from each direction: h(o) integral
 * h(i) f(o, i) |cos| di = (1 - coat albedo(o)) integral f(o, i) |cos| di, by Sinkhorn's balancing. */
static void balance(struct kiln_brushed_table *table, const struct kiln_bsdf_lobes *l)
{
    const struct base base = base_of(l);
    for (int k = 0; k < BALANCINGS; k++) {
        enum { points = KILN_BRUSHED_T * KILN_BRUSHED_U };
        float next[points];
        const double back = given_back_by(l);
        for (int at = 0; at < points; at++) {
            const float *values = &table->at[at * KILN_BRUSHED_VALUES];
            const struct kiln_vec3 o = point_direction(table, l, at);
            const double lost = base.all * (double)values[KILN_BRUSHED_WHOLE];
            double without, with;
            reflect(l, base, o, &without, &with);
            const double goal =
                (1.0 - COAT_LESS) * (1.0 - (double)kiln_bsdf_coat_albedo(*l, true, o.z)) * (without + lost);
            next[at] = (float)sqrt((double)values[KILN_BRUSHED_COAT] * goal / fmax(with + lost * back, 1e-12));
        }
        for (int at = 0; at < points; at++)
            table->at[at * KILN_BRUSHED_VALUES + KILN_BRUSHED_COAT] = next[at];
    }
}

/* The matt layer gets what is let in and not reflected. */
static void reflect_by_coat(struct kiln_brushed_table *table, const struct kiln_bsdf_lobes *l)
{
    for (int at = 0; at < KILN_BRUSHED_T * KILN_BRUSHED_U; at++) {
        float *values = &table->at[at * KILN_BRUSHED_VALUES];
        const struct kiln_vec3 o = point_direction(table, l, at);
        const double lets_in = 1.0 - (double)kiln_bsdf_coat_albedo(*l, true, o.z);
        double without, with;
        reflect(l, (struct base){0.0, 1.0}, o, &without, &with);
        if (without > 0.0)
            values[KILN_BRUSHED_FRESNEL] =
                (float)fmin((double)(values[KILN_BRUSHED_FRESNEL] * values[KILN_BRUSHED_COAT]) * with /
                                (without * fmax(lets_in, 1e-6)),
                            1.0);
    }
}

void kiln_brushed_tabulate(struct kiln_brushed_table *table, const struct kiln_bsdf_lobes *l)
{
    const float inside = 1.0f - 1.0f / (l->face.index * l->face.index);
    table->corner = fminf(fmaxf(sqrtf(sqrtf(inside)), 0.25f), 0.9f);
    for (int at = 0; at < KILN_BRUSHED_T * KILN_BRUSHED_U; at++)
        tabulate(&table->at[at * KILN_BRUSHED_VALUES], l, point_direction(table, l, at));
    if (!(l->coat.strength > 0.0f))
        return;
    struct kiln_bsdf_lobes own = *l;
    kiln_brushed_move(&own, (uint64_t)(uintptr_t)table);
    balance(table, &own);
    if (l->matt > 0.0f)
        reflect_by_coat(table, &own);
}

/* ---- means ---- */

/* Means over the hemisphere by the cosine, as kiln_bsdf_means finds them. */
static void find_means(struct kiln_bsdf_lobes *l)
{
    double lost = 0.0, front = 0.0, back = 0.0, coat = 0.0, under_front = 0.0, under_back = 0.0, held = 0.0;
    for (int k = 0; k < RINGS * SECTORS; k++) {
        const float mu = sqrtf(((float)(k / SECTORS) + 0.5f) / (float)RINGS);
        const struct kiln_vec3 w = direction_of(mu, k % SECTORS), behind = vec3(w.x, w.y, -w.z);
        const float facets = kiln_bsdf_facets_lost(*l, w), there = kiln_bsdf_glass_lost(*l, true, w, facets);
        lost += (double)facets;
        front += (double)there;
        back += (double)kiln_bsdf_glass_lost(*l, false, w, facets);
        coat += (double)(there * (1.0f - kiln_bsdf_coat_albedo(*l, true, mu)));
        under_front += (double)kiln_diffuse_in(*l, w);
        under_back += (double)kiln_diffuse_in(*l, behind);
        held += (double)kiln_bsdf_held(*l, w);
    }
    const double all = 1.0 / (RINGS * SECTORS);
    const bool glass = l->glass > 0.0f;
    l->lost_mean = (float)(lost * all);
    l->glass_lost_front = glass ? (float)(front * all) : 0.0f;
    l->glass_lost_back = glass ? (float)(back * all) : 0.0f;
    l->glass_lost_coat = glass ? (float)(coat * all) : 0.0f;
    l->under_front = l->matt > 0.0f ? (float)(under_front * all) : 1.0f;
    l->under_back = l->matt > 0.0f ? (float)(under_back * all) : 1.0f;
    l->held_mean = l->holds != 0 ? (float)(held * all) : 0.0f;
}

/* ---- means over the azimuth, as curves ---- */

enum { KNOTS = 9 };

/* The polynomial through values at places, in powers (Newton's divided differences). */
static struct kiln_curve curve_through(const double x[KNOTS], const double y[KNOTS])
{
    double divided[KNOTS], power[KNOTS] = {0.0};
    struct kiln_curve s;
    memcpy(divided, y, sizeof divided);
    for (int k = 1; k < KNOTS; k++)
        for (int i = KNOTS - 1; i >= k; i--)
            divided[i] = (divided[i] - divided[i - 1]) / (x[i] - x[i - k]);
    for (int i = KNOTS - 1; i >= 0; i--) { /* power = power (x - x[i]) + divided[i] */
        for (int k = KNOTS - 1; k > 0; k--)
            power[k] = power[k - 1] - x[i] * power[k];
        power[0] = divided[i] - x[i] * power[0];
    }
    for (int k = 0; k < KNOTS; k++)
        s.c[k] = (float)power[k];
    return s;
}

/* The cosine at which a smooth interface reflects this share. */
static double cosine_of(double share, float index)
{
    double low = 0.0, high = 1.0;
    for (int k = 0; k < 30; k++) {
        const double mu = 0.5 * (low + high);
        if ((double)kiln_fresnel((float)mu, index) > share)
            low = mu;
        else
            high = mu;
    }
    return 0.5 * (low + high);
}

/* What facets lose and reflect of light of one cosine, over all azimuths. */
static void about(const struct kiln_bsdf_lobes *l, float mu, double *lost, double *fresnel)
{
    double sent = 0.0, reflected = 0.0;
    for (int k = 0; k < SECTORS; k++) {
        const struct kiln_vec3 w = direction_of(mu, k);
        const double share = 1.0 - (double)kiln_bsdf_facets_lost(*l, w);
        sent += share;
        reflected += share * (double)kiln_bsdf_from_table(*l, w, KILN_BRUSHED_FRESNEL);
    }
    *lost = 1.0 - sent / SECTORS;
    *fresnel = sent > 0.0 ? reflected / sent : 1.0;
}

static void find_face(struct kiln_bsdf_lobes *l)
{
    const double alpha = (double)l->face.alpha, most = 2.0 / sqrt(1.0 + 2.0 * alpha) - 1.0;
    double x[KNOTS], lost[KNOTS], off[KNOTS];
    for (int k = 0; k < KNOTS; k++) {
        x[k] = -1.0 + 0.5 * (most + 1.0) * (1.0 + cos(KILN_PI * (k + 0.5) / KNOTS));
        const double near = 0.5 * (x[k] + 1.0), mu = fmin(2.0 * alpha * near * near / (1.0 - near * near), 1.0);
        double fresnel;
        about(l, (float)mu, &lost[k], &fresnel);
        off[k] = (cosine_of(fresnel, l->face.index) - mu) / sqrt(alpha);
    }
    l->face.lost = curve_through(x, lost);
    l->face.effective = curve_through(x, off);
}

void kiln_brushed_use(struct kiln_bsdf_lobes *l, const struct kiln_brushed_table *table)
{
    kiln_brushed_move(l, (uint64_t)(uintptr_t)table);
    find_face(l);
    find_means(l);
    kiln_bsdf_dye(l, l->p.base_color);
}
