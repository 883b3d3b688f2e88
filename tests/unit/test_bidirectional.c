/* Weights of bidirectional paths: those of all techniques that can find a path, each from the sums that its two
 * subpaths carry, against the densities of the whole path by each technique. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "shaders/shared/random.h"
#include "shaders/shared/bidirectional_weights.h"

enum { SURFACES = 7 };

/* A path: the light is 0, surfaces are 1 ... count, then comes the camera. Cosines towards the light and towards the
 * eye, squared distances to what comes next, densities of going on towards the eye and towards the light. */
struct path {
    int count;
    double in[SURFACES + 2], out[SURFACES + 2], squared[SURFACES + 2], to_eye[SURFACES + 2], to_light[SURFACES + 2];
    bool delta[SURFACES + 2];
    double connect, emission, camera, paths; /* `camera`: per m2 of the last surface */
    bool is_point, is_outside;
    struct kiln_path_techniques techniques;
};

static double number(uint32_t *state, double low, double high)
{
    *state = kiln_hash1(*state + 1u);
    return low * pow(high / low, (double)*state / 4294967296.0);
}

static struct path make(uint32_t seed, bool merges)
{
    uint32_t state = seed;
    struct path p = {.count = 1 + (int)number(&state, 1.0, SURFACES)};
    for (int i = 0; i <= p.count; i++) {
        p.in[i] = number(&state, 0.05, 1.0);
        p.out[i] = number(&state, 0.05, 1.0);
        p.squared[i] = number(&state, 0.01, 100.0);
        p.to_eye[i] = number(&state, 0.01, 10.0);
        p.to_light[i] = number(&state, 0.01, 10.0);
        p.delta[i] = i > 0 && number(&state, 1.0, 10.0) < 1.8;
    }
    p.connect = number(&state, 0.01, 10.0);
    p.emission = number(&state, 0.01, 10.0);
    p.camera = number(&state, 1.0, 1e4);
    p.paths = 4096.0;
    p.is_point = seed % 3 == 0;
    p.is_outside = seed % 5 == 0;
    if (p.is_outside)
        p.squared[0] = 1.0;
    if (p.is_outside || p.is_point)
        p.out[0] = 1.0;
    if (merges) {
        p.techniques.merges = number(&state, 1e-3, 10.0);
        p.techniques.connections = 1.0 / p.techniques.merges;
    }
    return p;
}

/* ---- densities of the whole path ---- */

/* Density of the first k surfaces by a path of light; of the last k by one from the camera. */
static double of_light(const struct path *p, int k)
{
    double density = p->emission * p->in[1] / p->squared[0];
    for (int i = 1; i < k; i++)
        density *= p->to_eye[i] * p->in[i + 1] / p->squared[i];
    return density;
}
static double of_eye(const struct path *p, int k)
{
    double density = p->camera;
    for (int i = p->count; i > p->count - k + 1; i--)
        density *= p->to_light[i] * p->out[i - 1] / p->squared[i - 1];
    return density;
}

/* Techniques: 0, the light is met; 1, it is sampled; 1 + k, k surfaces are light's; then merged at surface k. */
static double density_of(const struct path *p, int technique)
{
    const int m = p->count;
    if (technique == 0)
        return p->is_point ? 0.0 : of_eye(p, m) * p->to_light[1] * p->out[0] / p->squared[0];
    if (technique == 1)
        return p->delta[1] ? 0.0 : of_eye(p, m) * p->connect;
    if (technique <= m + 1) {
        const int k = technique - 1;
        if (p->delta[k] || (k < m && p->delta[k + 1]))
            return 0.0;
        return of_light(p, k) * (k < m ? of_eye(p, m - k) : p->paths);
    }
    const int k = technique - (m + 1);
    return p->delta[k] ? 0.0 : of_light(p, k) * of_eye(p, m - k + 1) * p->techniques.merges;
}

/* ---- weights ---- */

static struct kiln_path_sums light_sums(const struct path *p, int k)
{
    struct kiln_path_sums s = kiln_path_begin_light(&p->techniques, p->connect, p->emission, p->out[0], p->is_point);
    kiln_path_arrive(&s, p->squared[0], p->in[1]);
    for (int i = 1; i < k; i++) {
        kiln_path_leave(&p->techniques, &s, p->out[i], p->to_eye[i], p->to_light[i], p->delta[i]);
        kiln_path_arrive(&s, p->squared[i], p->in[i + 1]);
    }
    return s;
}
/* At the k-th surface from the camera, before it is left; the light counts as one. */
static struct kiln_path_sums eye_sums(const struct path *p, int k)
{
    struct kiln_path_sums s = {.vcm = p->paths / p->camera};
    for (int i = p->count; i > p->count - k + 1; i--) {
        kiln_path_leave(&p->techniques, &s, p->in[i], p->to_light[i], p->to_eye[i], p->delta[i]);
        kiln_path_arrive(&s, p->squared[i - 1], p->out[i - 1]);
    }
    return s;
}

static double weight_of(const struct path *p, int technique)
{
    const int m = p->count;
    const struct kiln_path_techniques *t = &p->techniques;
    if (technique == 0) {
        const struct kiln_path_sums eye = eye_sums(p, m + 1);
        return kiln_path_weight_met(&eye, p->connect, p->emission);
    }
    if (technique == 1) {
        const struct kiln_path_sums eye = eye_sums(p, m);
        const double hit = p->is_point ? 0.0 : p->to_light[1] * p->out[0] / p->squared[0];
        return kiln_path_weight_sampled(t, &eye, p->connect, p->emission, p->in[1] / p->squared[0], hit, p->to_eye[1]);
    }
    const int k = technique <= m + 1 ? technique - 1 : technique - (m + 1);
    const struct kiln_path_sums light = light_sums(p, k);
    if (technique == m + 1)
        return kiln_path_weight_seen(t, &light, p->camera / p->paths, p->to_light[m]);
    const struct kiln_path_sums eye = eye_sums(p, technique <= m ? m - k : m - k + 1);
    if (technique > m + 1)
        return kiln_path_weight_merged(t, &eye, &light, p->to_light[k], p->to_eye[k]);
    return kiln_path_weight_connected(t, &eye, &light, p->to_light[k + 1] * p->out[k] / p->squared[k], p->to_light[k],
                                      p->to_eye[k] * p->in[k + 1] / p->squared[k], p->to_eye[k + 1]);
}

/* The weight of each technique is its share of the densities of all, and they add up to 1. */
static void weights_are_shares_of_densities(void **state)
{
    (void)state;
    double worst = 0.0;
    int found = 0;
    for (uint32_t seed = 0; seed < 20000; seed++) {
        const struct path p = make(seed, seed % 2 == 0);
        const int techniques = p.techniques.merges > 0.0 ? 2 * p.count + 2 : p.count + 2;
        double all = 0.0, sum = 0.0;
        for (int i = 0; i < techniques; i++)
            all += density_of(&p, i);
        if (!(all > 0.0))
            continue; /* mirrors on the way of a point's light: nothing finds it */
        found++;
        for (int i = 0; i < techniques; i++) {
            const double share = density_of(&p, i) / all, weight = share > 0.0 ? weight_of(&p, i) : 0.0;
            worst = fmax(worst, fabs(weight - share));
            sum += weight;
        }
        assert_true(fabs(sum - 1.0) < 1e-5);
    }
    print_message("%d paths, weights off by %.3g at most\n", found, worst);
    assert_true(found > 15000 && worst < 1e-9);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(weights_are_shares_of_densities)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
