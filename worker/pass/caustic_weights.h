/* How the four ways of finding a caustic's light weigh against each other: multiple importance sampling (Veach,
 * "Robust Monte Carlo Methods for Light Transport Simulation", 1997, section 9.2) by a recursion like that of vertex
 * connection and merging (Georgiev, "Implementing Vertex Connection and Merging", technical report, 2012, section 4),
 * of which only these techniques are left. A path is a lamp's place y, surfaces with gloss z_1 ... z_k, k >= 1, z_1 met
 * first by light, and a place x in a texel. It is found by
 *
 *     hit     a gather ray of x that goes on by z_k ... z_1 and meets the emitter or leaves for the sky; density
 *             (n / A) p(x -> z_k) ... p(z_1 -> y)
 *     sample  the same up to z_1, and a sample of the lights there
 *     land    a light path that is aimed from y at the target of z_1 (worker/light/aims.h) and lands at x; density
 *             N p(y -> z_1) ... p(z_k -> x)
 *     connect the place x of a gather ray and, picked for it, where a light path has met z_k; density
 *             (n / A) s N p(y -> z_1) ... p(z_k-1 -> z_k)
 *
 * with n gather rays of the point, the texel's area A that is there to be lit, N light paths of the aim in all, and s
 * the connections of a gather ray's place over the light paths of all aims: 0 where nothing is connected.
 * Each subpath carries the densities of the techniques of the other side over its own, as a product over its surfaces;
 * from these each weight follows at once: with r the densities of the other techniques over a technique's own,
 *
 *     balance   1 / (1 + sum of r)          power     1 / (1 + sum of r^2)
 *     uniform   1 / (1 + how many r are above 0)
 *
 *     variance, correlation: as balance, with each density times a factor of its technique in the region of x
 *     (worker/pass/weighed.h), by which r changes to r c_other / c_own
 *     optimal: with w_h, w_s, w_l those of balance and exchanges a, b of the region of x
 *         w_h (1 + a w_s + b w_l),      w_s (1 - a w_h + b w_l),      w_l (1 - b (w_h + w_s))
 *
 * Densities are per steradian where they say `forward` (with which the subpath is drawn on from a surface) or
 * `backward` (with which a subpath of the other side would leave by the way that this one has come); cosines are those
 * of geometric normals, absolute. At x gather rays count as drawn by the cosine to the geometric normal. Roulette,
 * chances of surfaces that let light through, and the chance of landing on a side with gloss are in no density: the
 * weights of a path add up to 1 all the same. What devices reckon too is in shaders/shared/caustic_weights.h.
 * Pure functions. */
#ifndef KILN_WORKER_PASS_CAUSTIC_WEIGHTS_H
#define KILN_WORKER_PASS_CAUSTIC_WEIGHTS_H

#include <math.h>
#include <stdbool.h>

#include "shaders/shared/caustic_weights.h"

/* What weights take from one technique and give to another. */
enum kiln_caustic_exchanges { KILN_CAUSTIC_SAMPLES_TO_HITS, KILN_CAUSTIC_LANDINGS_TO_RAYS, KILN_CAUSTIC_EXCHANGES };

/* Factors of samples' and of landings' densities over that of hits, and the exchanges of --mis optimal, -1 to 1: the
 * same for all techniques of a texel. */
struct kiln_caustic_factors {
    float sample, land, exchange[KILN_CAUSTIC_EXCHANGES];
};

static const struct kiln_caustic_factors kiln_caustic_factors_alike = {.sample = 1.0f, .land = 1.0f};

/* Whether pilots teach what the light is weighed by. */
static inline bool kiln_mis_learns(enum kiln_mis mis) { return mis >= KILN_MIS_VARIANCE; }
/* Whether the weights have factors. */
static inline bool kiln_mis_has_factors(enum kiln_mis mis)
{
    return mis == KILN_MIS_VARIANCE || mis == KILN_MIS_CORRELATION;
}

/* ---- exchanges ---- */

/* Of a path with a weight of balance, what each exchange by 1 adds to the weight over the weight: by the weights that
 * the other techniques have. The arguments are those of the weight. */
static inline void kiln_caustic_exchange_hit(const struct kiln_caustic_gathered *g, double weight, double connect,
                                             double emission, double more[KILN_CAUSTIC_EXCHANGES])
{
    more[KILN_CAUSTIC_SAMPLES_TO_HITS] = weight * connect * g->sampled;
    more[KILN_CAUSTIC_LANDINGS_TO_RAYS] = weight * emission * g->land;
}

static inline void kiln_caustic_exchange_sampled(const struct kiln_caustic_gathered *g, double weight, double connect,
                                                 double emission, double towards, double hit, double backward,
                                                 double more[KILN_CAUSTIC_EXCHANGES])
{
    more[KILN_CAUSTIC_SAMPLES_TO_HITS] = -weight * hit / connect;
    more[KILN_CAUSTIC_LANDINGS_TO_RAYS] = weight * emission / connect * towards * g->land * backward;
}

/* Of KILN_CAUSTIC_LANDINGS_TO_RAYS alone. */
static inline double kiln_caustic_exchange_landed(double weight) { return weight - 1.0; }

/* The weight with exchanges. */
static inline double kiln_caustic_exchanged(const struct kiln_caustic_factors *factors, double weight,
                                            const double more[KILN_CAUSTIC_EXCHANGES])
{
    double sum = 1.0;
    for (int e = 0; e < KILN_CAUSTIC_EXCHANGES; e++)
        sum += (double)factors->exchange[e] * more[e];
    return weight * fmax(0.0, sum);
}

static inline double kiln_caustic_exchanged_landed(const struct kiln_caustic_factors *factors, double weight)
{
    const double more[KILN_CAUSTIC_EXCHANGES] = {[KILN_CAUSTIC_LANDINGS_TO_RAYS] =
                                                     kiln_caustic_exchange_landed(weight)};
    return kiln_caustic_exchanged(factors, weight, more);
}

/* ---- landed ---- */

/* Of what kiln_caustic_others says the samples' part, which a factor of the texel is for. */
static inline double kiln_caustic_sampled(const struct kiln_caustic_landing *l) { return l->sampled / KILN_PI; }

/* What kiln_caustic_others would have said with factors of the texel, from what it has said without. */
static inline double kiln_caustic_others_by(const struct kiln_caustic_factors *factors, double others, double sampled)
{
    return fmax(0.0, others + ((double)factors->sample - 1.0) * sampled) / (double)factors->land;
}

/* The weight of a landing by what kiln_caustic_others has said, `rays` gather rays of the point and its area, m2. */
static inline double kiln_caustic_weight_landed(enum kiln_mis mis, double others, double rays, double area)
{
    if (!(others > 0.0))
        return 1.0;
    return 1.0 / (1.0 + (mis == KILN_MIS_UNIFORM ? others : kiln_mis_share(mis, others * rays / area)));
}

/* ---- connected ---- */

/* The weight of a connection of x with the light path that has arrived at z_k, its `first` surface or not. `finds`: the
 * density per m2 with which gather rays meet z_k, `backward`: with which they leave it by the way that light has come;
 * `reaches`: per m2 with which light goes on to x. `rays`, `area`: n and A. */
static inline double kiln_caustic_weight_connected(enum kiln_mis mis, const struct kiln_caustic_landing *l, bool first,
                                                   double connections, double finds, double backward, double reaches,
                                                   double rays, double area)
{
    const double over = finds / connections;
    return 1.0 / (1.0 + kiln_mis_share(mis, over * l->hit * backward) +
                  kiln_mis_share(mis, over * l->sampled * (first ? 1.0 : backward)) +
                  kiln_mis_share(mis, reaches * area / (rays * connections)));
}

#endif
