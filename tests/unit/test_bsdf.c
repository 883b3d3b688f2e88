/* Tests of the scattering functions of whole materials (shaders/shared/bsdf.h) against what they promise: draws agree
 * with densities, nothing is lost in a white furnace, reciprocity, known values. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shaders/shared/bsdf.h"
#include "shaders/shared/random.h"
#include "tests/unit/bsdf_checks.h"

/* Draw k. */
static struct kiln_bsdf_drawn draw(const struct kiln_bsdf_lobes *l, struct kiln_vec3 o, uint32_t k,
                                   enum numbers numbers, uint32_t lobes)
{
    float p[3];
    for (uint32_t c = 0; c < 3; c++)
        p[c] = kiln_unit_float(numbers == EVEN ? kiln_owen_scramble(kiln_sobol(k, c), kiln_hash1(c))
                                               : kiln_hash1(3 * k + c));
    return kiln_bsdf_draw(*l, o, p[0], p[1], p[2], KILN_IMPORTANCE, lobes);
}

/* ---- what any implementation is asked ---- */

static struct lobes_answer answer(const struct kiln_bsdf_lobes *l, const struct lobes_query *q)
{
    if (q->draws == 0) {
        const struct kiln_bsdf_value s = kiln_bsdf_evaluate(*l, q->o, q->i, q->mode, q->which);
        return (struct lobes_answer){.i = q->i, .value = s.value, .density = s.density};
    }
    const struct kiln_bsdf_drawn d = kiln_bsdf_draw(*l, q->o, q->pick, q->u, q->v, q->mode, q->which);
    const bool turns = q->turns != 0 && d.i.z != 0.0f;
    return (struct lobes_answer){.i = d.i,
                                 .value = d.weight,
                                 .density = d.density,
                                 .backward = turns ? kiln_bsdf_reverse(*l, q->o, d, q->which) : 0.0f,
                                 .delta = d.delta};
}

static void ask(void *context, const struct kiln_bsdf_lobes *lobes, size_t lobes_count,
                const struct lobes_query *queries, size_t count, struct lobes_answer *answers)
{
    (void)context, (void)lobes_count;
#pragma omp parallel for schedule(static)
    for (size_t k = 0; k < count; k++)
        answers[k] = answer(&lobes[queries[k].lobes], &queries[k]);
}
static struct lobes_source here = {.ask = ask}; /* thin: in main */

/* ---- a white furnace ---- */

/* The energy that is sent on of all that comes from o. */
static double albedo(const struct kiln_bsdf_lobes *l, struct kiln_vec3 o, unsigned draws, uint32_t lobes)
{
    double sum = 0.0;
    for (unsigned k = 0; k < draws; k++) {
        const double weight = (double)draw(l, o, k, EVEN, lobes).weight.y;
        assert_true(weight >= 0.0 && weight < 1e6);
        sum += weight;
    }
    return sum / draws;
}

/* The mean of a factor of the diffuse surface over the hemisphere by the cosine. */
static double stored_mean(const struct kiln_bsdf_lobes *l, bool in)
{
    enum { STEPS = 500, TURNS = 16 };
    double sum = 0.0;
    for (int k = 0; k < STEPS * TURNS; k++) {
        const float mu = sqrtf(((float)(k / TURNS) + 0.5f) / (float)STEPS), r = sqrtf(1.0f - mu * mu);
        const float turn = 0.5f * (float)KILN_PI * ((float)(k % TURNS) + 0.5f) / (float)TURNS;
        sum += (double)(in ? kiln_diffuse_in_about(*l, mu)
                           : kiln_diffuse_out(*l, vec3(r * cosf(turn), r * sinf(turn), mu)));
    }
    return sum / (STEPS * TURNS);
}

/* The diffuse surface by its two factors, as a bake stores it: with what is above it, all light comes back. */
static void stored_of(const struct material *m, float alpha, float azimuth)
{
    struct lobes_batch b = {0};
    batch_prepare(&b, 0, m, white_material(m, alpha));
    const struct kiln_bsdf_lobes *l = &b.lobes[0];
    const double in = stored_mean(l, true);
    assert_true(fabs(stored_mean(l, false) - 1.0) < 1e-3);
    for (int j = 0; j < ANGLES; j++) {
        const struct kiln_vec3 o = direction(degrees[j], azimuth, false);
        const double stored = (double)kiln_diffuse_out(*l, o) * in;
        const double drawn = albedo(l, o, 64, KILN_LOBE_DIFFUSE);
        const double above = albedo(l, o, 2048, KILN_LOBE_GLOSS | KILN_LOBE_COAT);
        assert_true(fabs(stored - drawn) < 0.02 * stored || m->anisotropy > 0.0f); /* 64 know few azimuths */
        assert_true(stored + above > 0.99 && stored + above < 1.002);
    }
    batch_end(&b);
}

static void stored_diffuse(void **state)
{
    (void)state;
    for (size_t i = 0; i < MATERIALS; i++) {
        const bool matt = materials[i].metallic == 0.0f && materials[i].transmission == 0.0f;
        const bool asked = matt && (materials[i].coat > 0.0f || materials[i].anisotropy > 0.0f);
        for (int a = 0; a < ALPHAS && asked; a += here.thin ? 3 : 1)
            for (int k = 0; k < azimuths_of(&materials[i]); k = next_azimuth(&materials[i], k))
                stored_of(&materials[i], alphas[a], azimuths[k]);
    }
}

static void furnaces(void **state)
{
    (void)state;
    check_furnaces(&here);
}

static void draws(void **state)
{
    (void)state;
    check_draws(&here);
}

static void reciprocities(void **state)
{
    (void)state;
    check_reciprocities(&here);
}

/* ---- known values ---- */

/* Returns the share of light at normal incidence that the smooth face sends on to one side. */
static double smooth_share(struct kiln_bsdf p, bool behind, bool reflected, uint32_t mode)
{
    const struct kiln_bsdf_lobes l = kiln_bsdf_prepare(p);
    const struct kiln_bsdf_drawn d =
        kiln_bsdf_draw(l, vec3(0.0f, 0.0f, behind ? -1.0f : 1.0f), reflected ? 1e-6f : 1.0f - 1e-6f, 0.5f, 0.5f, mode,
                       KILN_LOBE_GLOSS);
    assert_true(d.delta && (d.i.z > 0.0f) == (behind != reflected));
    return (double)(d.weight.y * d.density);
}

static void panes(void **state)
{
    (void)state;
    struct kiln_bsdf p = white_material(&materials[GLASS], 0.0f);
    for (uint32_t mode = KILN_RADIANCE; mode <= KILN_IMPORTANCE; mode++) {
        const double in = smooth_share(p, false, false, mode), out = smooth_share(p, true, false, mode);
        const double inside = smooth_share(p, true, true, mode);
        assert_true(fabs(in * out / (1.0 - inside * inside) - 0.9230769) < 1e-5);
        assert_true(fabs(in - (mode == KILN_RADIANCE ? 0.96 / 2.25 : 0.96)) < 1e-5);
    }
    p.thin_wall = 1;
    assert_true(fabs(smooth_share(p, false, false, KILN_RADIANCE) - 0.96) < 1e-5);
    assert_true(fabs(smooth_share(p, false, true, KILN_RADIANCE) - 0.04) < 1e-5);
}

static void interfaces(void **state)
{
    (void)state;
    assert_true(fabs((double)kiln_fresnel(1.0f, 1.5f) - 0.04) < 1e-6);
    assert_true(fabs((double)kiln_fresnel(0.5f, 1.5f) - 0.08918670) < 1e-6); /* at 60 degrees */
    assert_true(kiln_fresnel(0.5f, 1.0f / 1.5f) == 1.0f && kiln_fresnel(0.0f, 1.5f) == 1.0f);
    for (float cosine = 0.0f; cosine <= 1.0f; cosine += 0.125f)
        assert_true(kiln_fresnel(cosine, 1.0f) < 1e-12f);
    const float brewster = 1.0f / sqrtf(1.0f + 1.5f * 1.5f); /* half of one polarisation: ((n^2 - 1) / (n^2 + 1))^2 */
    assert_true(fabs((double)kiln_fresnel(brewster, 1.5f) - 0.5 * 1.25 * 1.25 / (3.25 * 3.25)) < 1e-6);
    const struct kiln_vec3 n = kiln_dispersed_index(1.5f, 0.4f); /* Abbe number 50 */
    const double wave[3] = {611.4, 549.1, 464.3};
    for (int c = 0; c < 3; c++)
        assert_true(fabs((double)(&n.x)[c] - (1.5 + 0.5 / 50.0 * (523655.0 / (wave[c] * wave[c]) - 1.5168))) < 1e-6);
}

/* Index 1 is not seen, however rough; a straight line goes through. */
static void nothing_there(void **state)
{
    (void)state;
    for (int thin = 0; thin < 2; thin++) {
        struct kiln_bsdf p = white_material(&materials[GLASS], thin != 0 ? 0.0f : 0.4f);
        p.eta = vec3(1.0f, 1.0f, 1.0f);
        p.thin_wall = (uint32_t)thin;
        const struct kiln_bsdf_lobes l = kiln_bsdf_prepare(p);
        const struct kiln_vec3 o = direction(70.0f, 1.0f, thin != 0);
        const struct kiln_bsdf_drawn d = kiln_bsdf_draw(l, o, 0.001f, 0.5f, 0.5f, KILN_RADIANCE, KILN_LOBE_ALL);
        assert_true(d.delta && vec3_length(vec3_add(d.i, o)) < 1e-6f && fabsf(d.weight.y - 1.0f) < 1e-5f);
    }
}

/* Colours part in smooth and rough glass; each keeps the energy that it has without dispersion. */
static void dispersion(void **state)
{
    (void)state;
    for (int rough = 0; rough < 2; rough++) {
        struct kiln_bsdf p = white_material(&materials[GLASS], rough != 0 ? 0.2f : 0.0f);
        const struct kiln_vec3 o = direction(50.0f, 0.3f, false);
        p.eta = kiln_dispersed_index(1.5f, 2.0f);
        const struct kiln_bsdf_lobes l = kiln_bsdf_prepare(p);
        struct kiln_vec3 sum = vec3(0.0f, 0.0f, 0.0f), bent = sum;
        for (unsigned k = 0; k < 8192; k++) {
            const struct kiln_bsdf_drawn d = draw(&l, o, k, EVEN, KILN_LOBE_ALL);
            sum = vec3_madd(sum, d.weight, 1.0f / 8192.0f);
            if (d.i.z < 0.0f)
                bent = vec3_madd(bent, d.weight, -d.i.z / 8192.0f);
        }
        for (int c = 0; c < 3; c++)
            assert_true(fabs((double)(&sum.x)[c] - 1.0) < 0.015);
        assert_true(bent.x < 0.9995f * bent.y && bent.y < 0.9995f * bent.z);
    }
}

/* ---- the older models ---- */

static double reciprocity_from(const struct kiln_bsdf_lobes *l, struct kiln_vec3 o)
{
    struct lobes_batch b = {.source = &here, .lobes = {*l}, .lobes_count = 1};
    for (uint32_t k = 1; k <= 64; k++)
        batch_draw(&b, 0, o, k, EVEN);
    const double off = reciprocity_of(&b);
    batch_end(&b);
    return off;
}

static void older_models(void **state)
{
    (void)state;
    const float exponents[4] = {1.0f, 10.0f, 100.0f, 5000.0f};
    for (int i = 0; i < 4; i++) {
        struct kiln_bsdf p = {.specular_color = {1, 1, 1}, .eta = {1.5f, 1.5f, 1.5f}, .specular = 1.0f};
        p.model = KILN_BSDF_PHONG;
        p.exponent = exponents[i];
        const struct kiln_bsdf_lobes phong = kiln_bsdf_prepare(p);
        assert_true(fabs(albedo(&phong, vec3(0, 0, 1), 4096, KILN_LOBE_ALL) - 1.0) < 0.002);
        p.model = KILN_BSDF_COOK_TORRANCE;
        p.alpha_x = p.alpha_y = 1.0f / exponents[i];
        const struct kiln_bsdf_lobes facets = kiln_bsdf_prepare(p);
        for (int j = 0; j < ANGLES; j++) {
            const struct kiln_vec3 o = direction(degrees[j], 0.3f, false);
            assert_true(albedo(&phong, o, 4096, KILN_LOBE_ALL) < 1.002);
            assert_true(albedo(&facets, o, 4096, KILN_LOBE_ALL) < 1.01);
            assert_true(reciprocity_from(&phong, o) < 1e-3); /* the power of a rounded cosine */
            assert_true(reciprocity_from(&facets, o) < 1e-5);
        }
        assert_true(exponents[i] < 100.0f || albedo(&facets, vec3(0, 0, 1), 4096, KILN_LOBE_ALL) > 0.99);
    }
}

/* ---- shading normals ---- */

static void shading_normals(void **state)
{
    (void)state;
    const struct kiln_vec3 o = direction(40.0f, 0.0f, false), i = direction(60.0f, 2.0f, false);
    const struct kiln_vec3 tilted = direction(20.0f, 0.5f, false);
    assert_true(fabsf(kiln_shading_correction(o, i, vec3(0, 0, 1)) - 1.0f) < 1e-6f);
    const float there = kiln_shading_correction(o, i, tilted), back = kiln_shading_correction(i, o, tilted);
    assert_true(fabsf(there * back - 1.0f) < 1e-6f && fabsf(there - 1.0f) > 0.05f);
    assert_true(kiln_shading_agrees(o, tilted) &&
                !kiln_shading_agrees(direction(85.0f, 0.5f + (float)KILN_PI, false), tilted));
}

int main(void)
{
    here.thin = getenv("KILN_TEST_FULL") == NULL;
    const struct CMUnitTest tests[] = {cmocka_unit_test(furnaces),      cmocka_unit_test(stored_diffuse),
                                       cmocka_unit_test(draws),         cmocka_unit_test(reciprocities),
                                       cmocka_unit_test(panes),         cmocka_unit_test(interfaces),
                                       cmocka_unit_test(nothing_there), cmocka_unit_test(dispersion),
                                       cmocka_unit_test(older_models),  cmocka_unit_test(shading_normals)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
