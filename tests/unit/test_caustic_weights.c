/* Weights of caustics: those of a hit, a sample of the lights and a landing, each from what its subpath
 * carries, against the densities of the whole path by each technique. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "shaders/shared/random.h"
#include "worker/pass/caustic_weights.h"

enum { SURFACES = 4, TECHNIQUES = 3 };

/* The lamp is 0, surfaces with gloss are 1 ... count, the texel is last. Cosines towards lamp and texel, squared
 * distances to what comes next, densities of going on towards texel and lamp. */
struct path {
    int count;
    double in[SURFACES + 2], out[SURFACES + 2], squared[SURFACES + 2], to_texel[SURFACES + 2], to_lamp[SURFACES + 2];
    bool delta[SURFACES + 2];
    double connect, emission, rays, area;
    bool is_point;
};

static double number(uint32_t *state, double low, double high)
{
    *state = kiln_hash1(*state + 1u);
    return low * pow(high / low, (double)*state / 4294967296.0);
}

static struct path make(uint32_t seed)
{
    uint32_t state = seed;
    struct path p = {.count = 1 + (int)(seed % SURFACES), .is_point = seed % 3 == 0};
    for (int i = 0; i <= p.count + 1; i++) {
        p.in[i] = number(&state, 0.05, 1.0);
        p.out[i] = number(&state, 0.05, 1.0);
        p.squared[i] = number(&state, 0.01, 100.0);
        p.to_texel[i] = number(&state, 0.01, 10.0);
        p.to_lamp[i] = number(&state, 0.01, 10.0);
        p.delta[i] = i > 0 && number(&state, 1.0, 10.0) < 2.0;
    }
    p.connect = seed % 7 == 0 ? 0.0 : number(&state, 0.01, 10.0);
    p.emission = number(&state, 0.01, 1e4);
    p.rays = number(&state, 1.0, 1e3);
    p.area = number(&state, 1e-4, 1.0);
    if (seed % 5 == 0) /* from outside */
        p.squared[0] = 1.0;
    if (seed % 5 == 0 || p.is_point)
        p.out[0] = 1.0;
    return p;
}

/* Finds the densities of the whole path by hit, sample and landing: per m2 of each place, with deltas as chances. */
static void find_densities(const struct path *p, double density[TECHNIQUES])
{
    const int m = p->count;
    double eye = p->rays / p->area * p->in[m + 1] / KILN_PI * p->out[m] / p->squared[m];
    for (int i = m; i > 1; i--)
        eye *= p->to_lamp[i] * p->out[i - 1] / p->squared[i - 1];
    density[0] = p->is_point ? 0.0 : eye * p->to_lamp[1] * p->out[0] / p->squared[0];
    density[1] = p->delta[1] ? 0.0 : eye * p->connect;
    double light = p->emission * p->in[1] / p->squared[0];
    for (int i = 1; i < m; i++)
        light *= p->to_texel[i] * p->in[i + 1] / p->squared[i];
    density[2] = light * p->to_texel[m] * p->in[m + 1] / p->squared[m];
}

/* The subpath from the texel, arrived at surface `last`, or at the lamp, 0. */
static struct kiln_caustic_gathered gathered(const struct path *p, int last)
{
    struct kiln_caustic_gathered g = kiln_caustic_gather(p->area, p->rays);
    for (int i = p->count; i >= last; i--) {
        kiln_caustic_arrive(&g, p->squared[i], p->out[i]);
        if (i > last)
            kiln_caustic_leave(&g, p->in[i], p->to_lamp[i], p->to_texel[i], p->delta[i]);
    }
    return g;
}

/* The light path, arrived at surface `last` or, if that is one more than there are, about to land. */
static struct kiln_caustic_landing sent(const struct path *p, int last)
{
    struct kiln_caustic_landing l =
        kiln_caustic_emit(p->connect, p->emission, p->out[0], p->is_point, p->squared[0], p->in[1]);
    for (int i = 1; i < last; i++) {
        kiln_caustic_pass_on(&l, i == 1, p->out[i], p->to_texel[i], p->to_lamp[i], p->delta[i]);
        if (i < p->count)
            kiln_caustic_meet(&l, p->in[i + 1]);
    }
    return l;
}

static double landed(const struct path *p, enum kiln_mis mis)
{
    const struct kiln_caustic_landing l = sent(p, p->count + 1);
    return kiln_caustic_weight_landed(mis, kiln_caustic_others(mis, &l), p->rays, p->area);
}

static double weight_of(const struct path *p, enum kiln_mis mis, int technique)
{
    if (technique == 2)
        return landed(p, mis);
    const struct kiln_caustic_gathered g = gathered(p, technique);
    const double hit = p->is_point ? 0.0 : p->to_lamp[1] * p->out[0] / p->squared[0];
    return technique == 0 ? kiln_caustic_weight_hit(mis, &g, p->connect, p->emission)
                          : kiln_caustic_weight_sampled(mis, &g, p->connect, p->emission, p->in[1] / p->squared[0], hit,
                                                        p->to_texel[1]);
}

/* Returns the weight that a path with these densities ought to have. */
static double expected(const double density[TECHNIQUES], enum kiln_mis mis, int technique)
{
    double sum = 0.0, own = 0.0;
    for (int i = 0; i < TECHNIQUES; i++) {
        const double part = mis == KILN_MIS_UNIFORM ? (density[i] > 0.0 ? 1.0 : 0.0)
                            : mis == KILN_MIS_POWER ? density[i] * density[i]
                                                    : density[i];
        sum += part;
        own = i == technique ? part : own;
    }
    return own / sum;
}

/* The weight of each technique is its share of all that can find the path, and they add up to 1. */
static void weights_are_shares_of_densities(void **state)
{
    (void)state;
    for (enum kiln_mis mis = KILN_MIS_BALANCE; mis <= KILN_MIS_UNIFORM; mis++) {
        double worst = 0.0;
        int several = 0;
        for (uint32_t seed = 0; seed < 6000; seed++) {
            const struct path p = make(seed);
            double density[TECHNIQUES], sum = 0.0, most = 0.0;
            find_densities(&p, density);
            for (int i = 0; i < TECHNIQUES; i++) {
                const double weight = density[i] > 0.0 ? weight_of(&p, mis, i) : 0.0;
                worst = fmax(worst, fabs(weight - expected(density, mis, i)));
                most = fmax(most, weight);
                sum += weight;
            }
            assert_true(fabs(sum - 1.0) < 1e-9);
            several += most < 0.9;
        }
        print_message("rule %d: weights off by %.3g at most; %d paths that several techniques share\n", (int)mis, worst,
                      several);
        assert_true(worst < 1e-9 && several > 500);
    }
}

/* A mirror and a lamp without size: only light paths find that. */
static void only_landings_count_whole(void **state)
{
    (void)state;
    struct path p = make(3);
    p.is_point = p.delta[1] = p.delta[p.count] = true;
    for (enum kiln_mis mis = KILN_MIS_BALANCE; mis <= KILN_MIS_UNIFORM; mis++)
        assert_true(landed(&p, mis) == 1.0);
    p.delta[1] = false;
    assert_true(landed(&p, KILN_MIS_BALANCE) < 1.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(weights_are_shares_of_densities),
                                       cmocka_unit_test(only_landings_count_whole)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
