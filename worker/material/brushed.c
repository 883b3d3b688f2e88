#include "worker/material/brushed.h"

#include <math.h>
#include <string.h>

/* Safety margins: slightly less energy is given back than is lost, so that a furnace is hardly ever too bright. Between
 * its points a table may be too high by this. */
#define WHOLE_LESS 0.0008
#define THIN_LESS 0.0025
#define DENSE_LESS 0.0045
#define HELD_LESS 0.0025
#define COAT_LESS 0.0006
#define HELD_BETWEEN_LESS 0.0004f /* between roughnesses */
#define COAT_BETWEEN_LESS 0.0008f
#define FRESNEL_MORE 0.0006 /* the diffuse layer gets the light that is not reflected */

/* Number of facets for a direction: a Fibonacci lattice, for which the Fibonacci number before is needed, too. */
enum { FACETS = 987, FACETS_BEFORE = 610, FEW_FACETS = 377, FEW_FACETS_BEFORE = 233 };
enum { BALANCINGS = 4 };
/* Directions for hemispherical means: equal intervals of the squared cosine, and of a quarter turn. */
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

/* ---- facets visible from a direction ----
 *
 * Loops over facets have no branches, and only calls that are inlined, so that compilers vectorize them. */

/* Lattice points in the unit square for drawing facets, equal for all directions. */
struct lattice {
    int count;
    float cosine[FACETS], sine[FACETS], v[FACETS];
};

/* count and `before`: consecutive Fibonacci numbers. */
static void lattice_make(struct lattice *g, int count, int before)
{
    g->count = count;
    for (int j = 0; j < count; j++) {
        kiln_turn(((float)(j * before % count) + 0.5f) / (float)count, &g->sine[j], &g->cosine[j]);
        g->v[j] = ((float)j + 0.5f) / (float)count;
    }
}

/* Facet normals; the cosine to the facet; the visible share of the reflected direction: G2 / G1, 0 below the horizon.
 */
struct facets {
    float x[FACETS], y[FACETS], z[FACETS], cosine[FACETS], share[FACETS];
};

/* G2 / G1 of a direction on either side. `own`: stretch of the direction that light comes from, over its cosine. */
static inline float seen(float alpha_x, float alpha_y, float own, struct kiln_vec3 i)
{
    return (1.0f + own) / (own + kiln_ggx_stretch(i, alpha_x, alpha_y) / fabsf(i.z));
}

static inline float own_of(const struct kiln_bsdf_lobes *l, struct kiln_vec3 o)
{
    return kiln_ggx_stretch(o, l->alpha_x, l->alpha_y) / o.z;
}

/* Draws the facets visible from o, as kiln_ggx_sample does. */
static void see(struct facets *f, const struct lattice *g, const struct kiln_bsdf_lobes *l, struct kiln_vec3 o)
{
    const float alpha_x = l->alpha_x, alpha_y = l->alpha_y, own = own_of(l, o);
    const struct kiln_vec3 s = kiln_direction_of(vec3(alpha_x * o.x, alpha_y * o.y, o.z));
    for (int j = 0; j < g->count; j++) {
        const float z = (1.0f - g->v[j]) * (1.0f + s.z) - s.z;
        const float r = sqrtf(fmaxf(0.0f, (1.0f - z) * (1.0f + z)));
        const float x = alpha_x * (r * g->cosine[j] + s.x), y = alpha_y * (r * g->sine[j] + s.y),
                    up = fmaxf(z + s.z, 0.0f);
        const float scale = 1.0f / sqrtf(x * x + y * y + up * up);
        const struct kiln_vec3 h = vec3(x * scale, y * scale, up * scale), i = kiln_reflected(o, h);
        const float share = seen(alpha_x, alpha_y, own, i);
        f->x[j] = h.x;
        f->y[j] = h.y;
        f->z[j] = h.z;
        f->cosine[j] = vec3_dot(o, h);
        f->share[j] = i.z > 0.0f ? share : 0.0f;
    }
}

static double mean_of(const float *values, int count)
{
    double sum = 0.0;
    for (int j = 0; j < count; j++)
        sum += (double)values[j];
    return sum / count;
}

/* Returns the share of light that the facets reflect, as an interface with this index. */
static double reflected(const struct facets *f, int count, float index)
{
    float of[FACETS];
    for (int j = 0; j < count; j++)
        of[j] = f->share[j] * kiln_fresnel(f->cosine[j], index);
    return mean_of(of, count);
}

/* Returns the share of light that passes the facets into a medium `eta` times as dense. */
static double through(const struct facets *f, int count, const struct kiln_bsdf_lobes *l, struct kiln_vec3 o, float eta)
{
    const float alpha_x = l->alpha_x, alpha_y = l->alpha_y, own = own_of(l, o), ratio = 1.0f / eta;
    float of[FACETS];
    for (int j = 0; j < count; j++) {
        const float cosine = f->cosine[j], behind = kiln_refracted_cosine(cosine, eta),
                    back = kiln_fresnel(cosine, eta);
        const float along = ratio * cosine - behind; /* kiln_refracted */
        const float x = f->x[j] * along - ratio * o.x, y = f->y[j] * along - ratio * o.y,
                    z = f->z[j] * along - ratio * o.z;
        const float scale = 1.0f / sqrtf(x * x + y * y + z * z);
        const float share = seen(alpha_x, alpha_y, own, vec3(x * scale, y * scale, z * scale));
        of[j] = z < 0.0f ? (1.0f - back) * share : 0.0f;
    }
    return mean_of(of, count);
}

/* Returns the share of light that facets behind a coat scatter to both sides. */
static double sent_behind(const struct facets *f, int count, const struct kiln_bsdf_lobes *l, struct kiln_vec3 o)
{
    double sum = 0.0;
    for (int j = 0; j < count; j++)
        sum += (double)kiln_bsdf_sent_behind(*l, o, vec3(f->x[j], f->y[j], f->z[j]));
    return sum / count;
}

static void tabulate(float at[KILN_BRUSHED_VALUES], const struct lattice *g, const struct kiln_bsdf_lobes *l,
                     struct kiln_vec3 o)
{
    struct facets f;
    const float index = l->face.index;
    see(&f, g, l, o);
    const double whole = mean_of(f.share, g->count), from_thin = reflected(&f, g->count, index);
    at[KILN_BRUSHED_WHOLE] = (float)fmax(1.0 - WHOLE_LESS - whole, 0.0);
    at[KILN_BRUSHED_FRESNEL] = (float)(whole > 0.0 ? fmin(from_thin / whole + FRESNEL_MORE, 1.0) : 1.0);
    at[KILN_BRUSHED_THIN] = 0.0f;
    at[KILN_BRUSHED_DENSE] = 0.0f;
    at[KILN_BRUSHED_TRAPPED] = 0.0f;
    at[KILN_BRUSHED_COAT] = l->coat.strength > 0.0f ? kiln_coat_factor(l->coat, o.z) : 1.0f;
    if (!is_glass(l))
        return;
    const double thin = from_thin + through(&f, g->count, l, o, index);
    const double dense = reflected(&f, g->count, 1.0f / index) + through(&f, g->count, l, o, 1.0f / index);
    at[KILN_BRUSHED_THIN] = (float)fmax(1.0 - THIN_LESS - thin, 0.0);
    at[KILN_BRUSHED_DENSE] = (float)fmax(1.0 - DENSE_LESS - dense, 0.0);
    if (l->holds != 0) {
        const double bare = l->p.eta.y < 1.0f ? thin : dense; /* from behind, were there no coat */
        at[KILN_BRUSHED_TRAPPED] = (float)fmax(bare - sent_behind(&f, g->count, l, o) - HELD_LESS, 0.0);
    }
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

/* Shares of the base that scatter light to its front: `all` reflects all light, the facets of `partial` reflect as
 * glass. */
struct base {
    double all, partial;
};

static struct base base_of(const struct kiln_bsdf_lobes *l)
{
    const struct base s = {(double)(l->metal + (l->p.thin_wall != 0 ? l->glass : 0.0f)),
                           is_glass(l) ? (double)l->glass : 0.0};
    return s.all + s.partial > 0.0 ? s : (struct base){0.0, 1.0};
}

/* Finds the share of light from o that facets reflect, without and with the coat's factor for the reflected direction.
 */
static void reflect(const struct lattice *g, const struct kiln_bsdf_lobes *l, struct base base, struct kiln_vec3 o,
                    double *without, double *with)
{
    struct facets f;
    float share[FACETS];
    see(&f, g, l, o);
    for (int j = 0; j < g->count; j++)
        share[j] = f.share[j] * ((float)base.all + (float)base.partial * kiln_fresnel(f.cosine[j], l->face.index));
    *without = mean_of(share, g->count);
    const bool turned = l->alpha_x < l->alpha_y;
    for (int j = 0; j < g->count; j++) {
        const struct kiln_vec3 i = kiln_reflected(o, vec3(f.x[j], f.y[j], f.z[j]));
        if (share[j] > 0.0f)
            share[j] *=
                kiln_brushed_at(l->brushed_low, l->brushed_high, 0.0f, turned ? i.y : i.x, i.z, KILN_BRUSHED_COAT);
    }
    *with = mean_of(share, g->count);
}

/* Returns the mean of the coat's factor over light that compensates the facets' losses, weighted by these losses. */
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

/* Finds the coat's factor h, which makes a white base reflect all light that the coat lets in, for each direction: h(o)
 * integral h(i) f(o, i) |cos| di = (1 - coat albedo(o)) integral f(o, i) |cos| di, by Sinkhorn's balancing. */
static void balance(struct kiln_brushed_table *table, const struct lattice *g, const struct kiln_bsdf_lobes *l)
{
    const struct base base = base_of(l);
    for (int k = 0; k < BALANCINGS; k++) {
        enum { points = KILN_BRUSHED_T * KILN_BRUSHED_U };
        float next[points];
        const double back = given_back_by(l);
#pragma omp parallel for schedule(dynamic)
        for (int at = 0; at < points; at++) {
            const float *values = &table->at[at * KILN_BRUSHED_VALUES];
            const struct kiln_vec3 o = point_direction(table, l, at);
            const double lost = base.all * (double)values[KILN_BRUSHED_WHOLE];
            double without, with;
            reflect(g, l, base, o, &without, &with);
            const double goal =
                (1.0 - COAT_LESS) * (1.0 - (double)kiln_bsdf_coat_albedo(*l, true, o.z)) * (without + lost);
            next[at] = (float)sqrt((double)values[KILN_BRUSHED_COAT] * goal / fmax(with + lost * back, 1e-12));
        }
        for (int at = 0; at < points; at++)
            table->at[at * KILN_BRUSHED_VALUES + KILN_BRUSHED_COAT] = next[at];
    }
}

/* Finds the share for the diffuse layer: light that the coat lets in and facets do not reflect. */
static void reflect_by_coat(struct kiln_brushed_table *table, const struct lattice *g, const struct kiln_bsdf_lobes *l)
{
#pragma omp parallel for schedule(dynamic)
    for (int at = 0; at < KILN_BRUSHED_T * KILN_BRUSHED_U; at++) {
        float *values = &table->at[at * KILN_BRUSHED_VALUES];
        const struct kiln_vec3 o = point_direction(table, l, at);
        const double lets_in = 1.0 - (double)kiln_bsdf_coat_albedo(*l, true, o.z);
        double without, with;
        reflect(g, l, (struct base){0.0, 1.0}, o, &without, &with);
        if (without > 0.0)
            values[KILN_BRUSHED_FRESNEL] =
                (float)fmin((double)(values[KILN_BRUSHED_FRESNEL] * values[KILN_BRUSHED_COAT]) * with /
                                (without * fmax(lets_in, 1e-6)),
                            1.0);
    }
}

void kiln_brushed_tabulate(struct kiln_brushed_table *table, const struct kiln_bsdf_lobes *l)
{
    struct lattice lattice, few;
    lattice_make(&lattice, FACETS, FACETS_BEFORE);
    lattice_make(&few, FEW_FACETS, FEW_FACETS_BEFORE);
    const float inside = 1.0f - 1.0f / (l->face.index * l->face.index);
    table->corner = fminf(fmaxf(sqrtf(sqrtf(inside)), 0.25f), 0.9f);
#pragma omp parallel for schedule(dynamic)
    for (int at = 0; at < KILN_BRUSHED_T * KILN_BRUSHED_U; at++)
        tabulate(&table->at[at * KILN_BRUSHED_VALUES], &lattice, l, point_direction(table, l, at));
    if (!(l->coat.strength > 0.0f))
        return;
    struct kiln_bsdf_lobes own = *l;
    kiln_brushed_move(&own, (uint64_t)(uintptr_t)table);
    balance(table, &few, &own);
    if (l->matt > 0.0f)
        reflect_by_coat(table, &few, &own);
}

/* ---- means ---- */

/* Means over the hemisphere, weighted by the cosine, as kiln_bsdf_means computes them. */
static void find_means(struct kiln_bsdf_lobes *l)
{
    double lost = 0.0, front = 0.0, back = 0.0, coat = 0.0, under_front = 0.0, under_back = 0.0, trapped = 0.0;
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
        trapped += (double)kiln_bsdf_trapped(*l, w);
    }
    const double all = 1.0 / (RINGS * SECTORS);
    const bool glass = l->glass > 0.0f;
    l->lost_mean = (float)(lost * all);
    l->glass_lost_front = glass ? (float)(front * all) : 0.0f;
    l->glass_lost_back = glass ? (float)(back * all) : 0.0f;
    l->glass_lost_coat = glass ? (float)(coat * all) : 0.0f;
    l->under_front = l->matt > 0.0f ? (float)(under_front * all) : 1.0f;
    l->under_back = l->matt > 0.0f ? (float)(under_back * all) : 1.0f;
    l->trapped_mean = l->holds != 0 ? (float)(trapped * all) : 0.0f;
}

/* ---- means over the azimuth, as curves ---- */

enum { KNOTS = 9 };

/* The polynomial in powers of x that interpolates values (Newton's divided differences). */
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

/* Finds the shares that facets lose and reflect for one cosine, averaged over all azimuths. */
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

/* ---- layers ---- */

/* Means for lobes that use a layer of the table. */
static struct kiln_brushed_means means_of(const struct kiln_bsdf_lobes *l)
{
    double in[2] = {0.0, 0.0}, kept[2] = {0.0, 0.0}, share[2] = {0.0, 0.0};
    const float normal = kiln_fresnel_normal(l->face.index);
    for (int k = 0; k < RINGS * SECTORS; k++) {
        const float mu = sqrtf(((float)(k / SECTORS) + 0.5f) / (float)RINGS);
        const struct kiln_vec3 w = direction_of(mu, k % SECTORS);
        const double facets = 1.0 - (double)kiln_bsdf_from_table(*l, w, KILN_BRUSHED_WHOLE);
        const float exact = kiln_bsdf_from_table(*l, w, KILN_BRUSHED_FRESNEL);
        for (int side = 0; side < 2; side++) {
            const double lets_in = 1.0 - (double)kiln_bsdf_coat_albedo(*l, side == 0, mu);
            in[side] += lets_in;
            kept[side] += lets_in * facets;
            share[side] += lets_in * facets * (double)kiln_fresnel_share(exact, normal);
        }
    }
    const double all = 1.0 / (RINGS * SECTORS);
    return (struct kiln_brushed_means){.lost = l->lost_mean,
                                       .glass_front = l->glass_lost_front,
                                       .glass_back = l->glass_lost_back,
                                       .glass_coat = l->glass_lost_coat,
                                       .trapped = l->trapped_mean,
                                       .in_front = (float)(in[0] * all),
                                       .kept_front = (float)(kept[0] * all),
                                       .share_front = (float)(share[0] * all),
                                       .in_back = (float)(in[1] * all),
                                       .kept_back = (float)(kept[1] * all),
                                       .share_back = (float)(share[1] * all),
                                       .face_lost = l->face.lost,
                                       .face_effective = l->face.effective};
}

void kiln_brushed_use(struct kiln_bsdf_lobes *l, const struct kiln_brushed_table *table)
{
    kiln_brushed_move(l, (uint64_t)(uintptr_t)table);
    find_face(l);
    find_means(l);
    kiln_bsdf_dye(l, l->p.base_color);
}

struct kiln_layers kiln_layers_of(float least, float most, int steps)
{
    const float low = least * (float)steps, high = most * (float)steps;
    if (low == high)
        return (struct kiln_layers){low, low, 1};
    const float first = floorf(low), last = ceilf(high);
    return (struct kiln_layers){first, last, 1 + (int)(last - first)};
}

/* The material of layer k. */
static struct kiln_bsdf_lobes layer_lobes(const struct kiln_bsdf *p, float anisotropy, struct kiln_layers layers, int k)
{
    struct kiln_bsdf own = *p;
    const float step = (1.0f - KILN_BRUSHED_LEAST) / (float)(KILN_BRUSHED_LAYERS - 1);
    const float root = fminf(KILN_BRUSHED_LEAST + step * (layers.first + (float)k), 1.0f);
    kiln_bsdf_alphas(root * root, anisotropy, &own.alpha_x, &own.alpha_y);
    return kiln_bsdf_prepare(own);
}

void kiln_brushed_stack(struct kiln_brushed_table *tables, const struct kiln_bsdf *p, float anisotropy,
                        struct kiln_layers layers)
{
    for (int k = 0; k < layers.count; k++) {
        struct kiln_bsdf_lobes l = layer_lobes(p, anisotropy, layers, k);
        kiln_brushed_tabulate(&tables[k], &l);
        for (int at = 0; at < KILN_BRUSHED_T * KILN_BRUSHED_U && l.coat.strength > 0.0f; at++)
            tables[k].at[at * KILN_BRUSHED_VALUES + KILN_BRUSHED_COAT] *= 1.0f - COAT_BETWEEN_LESS;
        kiln_brushed_use(&l, &tables[k]);
        tables[k].means = means_of(&l);
        tables[k].first = layers.first;
        tables[k].last = layers.last;
    }
}

/* ---- what a coat over rough glass holds back ---- */

static struct kiln_curve held_curve(const struct kiln_bsdf *p, float roughness, float coat, float coat_roughness)
{
    struct kiln_bsdf own = *p;
    own.alpha_x = own.alpha_y = fmaxf(roughness * roughness, KILN_MIRROR_ALPHA);
    own.coat = coat;
    own.coat_alpha = coat_roughness * coat_roughness;
    struct kiln_bsdf_lobes l = kiln_bsdf_begin(own);
    l.holds = 1;
    struct kiln_curve curve = kiln_bsdf_trapped_curve(l);
    curve.c[0] -= HELD_BETWEEN_LESS;
    return curve;
}

void kiln_bsdf_trapped_tabulate(struct kiln_bsdf_trapped_table *table, const struct kiln_bsdf *p,
                                struct kiln_layers layers, struct kiln_layers coats)
{
    *table = (struct kiln_bsdf_trapped_table){
        .first = layers.first, .last = layers.last, .coat_first = coats.first, .coat_last = coats.last};
#pragma omp parallel for collapse(2) schedule(dynamic)
    for (int j = -1; j < coats.count; j++) /* -1: without a coat */
        for (int k = 0; k < layers.count; k++) {
            const float roughness = (layers.first + (float)k) / (float)(KILN_BSDF_TRAPPED_LAYERS - 1);
            if (j < 0)
                table->bare[k] = held_curve(p, roughness, 0.0f, 0.0f);
            else
                table->coated[KILN_BSDF_TRAPPED_LAYERS * j + k] =
                    held_curve(p, roughness, 1.0f, (coats.first + (float)j) / (float)(KILN_BSDF_TRAPPED_COATS - 1));
        }
}
