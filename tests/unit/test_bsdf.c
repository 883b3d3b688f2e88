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
#include "tests/unit/bsdf_materials.h"
#include "worker/sampling/sequence.h"

enum { ALPHAS = 10, ANGLES = 8 };

static const float alphas[ALPHAS] = {0.001f, 0.003f, 0.01f, 0.03f, 0.08f, 0.2f, 0.35f, 0.5f, 0.75f, 1.0f};
static const float degrees[ANGLES] = {0.0f, 15.0f, 30.0f, 45.0f, 60.0f, 70.0f, 80.0f, 85.0f};

static struct kiln_vec3 direction(float angle, float turn, bool behind)
{
    const float a = angle * (float)KILN_PI / 180.0f, z = cosf(a);
    return vec3(sinf(a) * cosf(turn), sinf(a) * sinf(turn), behind ? -z : z);
}

/* Three random numbers of draw k: points of Sobol's sequence, Owen-scrambled, or independent ones. */
enum numbers { EVEN, INDEPENDENT };
static struct kiln_bsdf_drawn draw(const struct kiln_bsdf_lobes *l, struct kiln_vec3 o, uint32_t k,
                                   enum numbers numbers, uint32_t lobes)
{
    float p[3];
    for (uint32_t c = 0; c < 3; c++)
        p[c] = kiln_unit_float(numbers == EVEN ? kiln_owen_scramble(kiln_sobol(k, c), kiln_hash1(c))
                                               : kiln_hash1(3 * k + c));
    return kiln_bsdf_draw(*l, o, p[0], p[1], p[2], KILN_IMPORTANCE, lobes);
}

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

/* Least and largest albedo over roughnesses and angles. */
static void furnace(const struct material *m, double range[2])
{
    range[0] = 2.0;
    range[1] = 0.0;
    for (int i = 0; i<ALPHAS; i += m->coat> 0.0f ? 3 : 1) {
        const struct kiln_bsdf_lobes l = kiln_bsdf_prepare(white_material(m, alphas[i]));
        for (int j = 0; j < ANGLES; j++) {
            const double a =
                albedo(&l, direction(degrees[j], 0.3f, m->behind), alphas[i] < 0.02f ? 1024 : 4096, KILN_LOBE_ALL);
            range[0] = fmin(range[0], a);
            range[1] = fmax(range[1], a);
        }
    }
}

static void furnaces(void **state)
{
    (void)state;
    for (size_t i = 0; i < MATERIALS; i++) {
        double range[2];
        furnace(&materials[i], range);
        print_message("%s: %.4f to %.4f\n", materials[i].name, range[0], range[1]);
        assert_true(range[0] >= (double)materials[i].darkest && range[1] <= (double)materials[i].brightest);
    }
}

/* The diffuse surface by its two factors, as a bake stores it: with what is above it, all light comes back. */
static void stored_diffuse(void **state)
{
    (void)state;
    for (int i = 0; i < ALPHAS; i++) {
        struct kiln_bsdf p = white_material(&materials[COATED_MATT], alphas[i]);
        const struct kiln_bsdf_lobes l = kiln_bsdf_prepare(p);
        const double step = 1e-3;
        double in = 0.0, out = 0.0;
        for (double mu = 0.5 * step; mu < 1.0; mu += step) {
            in += 2.0 * mu * step * (double)kiln_diffuse_in(l, (float)mu);
            out += 2.0 * mu * step * (double)kiln_diffuse_out(l, (float)mu);
        }
        assert_true(fabs(out - 1.0) < 1e-3);
        for (int j = 0; j < ANGLES; j++) {
            const struct kiln_vec3 o = direction(degrees[j], 0.3f, false);
            const double stored = (double)kiln_diffuse_out(l, o.z) * in;
            const double drawn = albedo(&l, o, 64, KILN_LOBE_DIFFUSE);
            const double above = albedo(&l, o, 2048, KILN_LOBE_GLOSS | KILN_LOBE_COAT);
            assert_true(fabs(stored - drawn) < 0.02 * stored);
            assert_true(stored + above > 0.985 && stored + above < 1.005);
        }
    }
}

/* ---- draws against densities ---- */

enum { RINGS = 18, SECTORS = 8, CELLS = 2 * RINGS * SECTORS, DRAWS = 4096 };

/* Cells about the mirror direction above the face of o, about the direction of smooth refraction beyond it. */
struct chart {
    struct kiln_dvec3 axis, s, t;
    double edges[RINGS + 1]; /* angles from the axis */
    double side;             /* 1: z > 0; -1: z < 0 */
};

static struct chart chart_about(struct kiln_vec3 axis, double alpha, double side)
{
    struct chart c = {.axis = dvec3_of(axis), .side = side};
    struct kiln_vec3 s, t;
    kiln_basis(axis, &s, &t);
    c.s = dvec3_of(s);
    c.t = dvec3_of(t);
    const double first = fmin(0.3, 0.3 * alpha);
    for (int k = 1; k <= RINGS; k++)
        c.edges[k] = first * pow(KILN_PI / first, (k - 1) / (RINGS - 1.0));
    return c;
}

static struct kiln_dvec3 chart_direction(const struct chart *c, double angle, double turn)
{
    const struct kiln_dvec3 round = dvec3_add(dvec3_scale(c->s, cos(turn)), dvec3_scale(c->t, sin(turn)));
    return dvec3_add(dvec3_scale(c->axis, cos(angle)), dvec3_scale(round, sin(angle)));
}

static int chart_cell(const struct chart *c, struct kiln_vec3 i)
{
    const struct kiln_dvec3 w = dvec3_of(i);
    const double x = dvec3_dot(w, c->s), y = dvec3_dot(w, c->t);
    const double angle = atan2(sqrt(x * x + y * y), dvec3_dot(w, c->axis));
    int ring = 0;
    while (ring < RINGS - 1 && angle >= c->edges[ring + 1])
        ring++;
    const int sector = (int)floor((atan2(y, x) / (2.0 * KILN_PI) + 1.0) * SECTORS) % SECTORS;
    return ring * SECTORS + sector;
}

/* The probability of a cell; *whole is false where the horizon cuts it. Near the horizon lobes are narrow across:
 * the sector is cut into pieces. */
static double cell_probability(const struct chart *c, int cell, const struct kiln_bsdf_lobes *l, struct kiln_vec3 o,
                               bool *whole)
{
    static const double place[4] = {0.06943184, 0.33000948, 0.66999052, 0.93056816};
    static const double share[4] = {0.17392742, 0.32607258, 0.32607258, 0.17392742};
    const int pieces = 1 + (int)(0.4 / fmax(fabs((double)o.z), 0.02));
    const double low = c->edges[cell / SECTORS], wide = c->edges[cell / SECTORS + 1] - low;
    const double turn = 2.0 * KILN_PI / SECTORS, from = turn * (cell % SECTORS);
    double sum = 0.0;
    *whole = true;
    for (int a = 0; a < 4; a++) /* corners */
        *whole = *whole && chart_direction(c, low + (a & 1) * wide, from + (a >> 1) * turn).z * c->side > 0.0;
    for (int a = 0; a < 16 * pieces; a++) {
        const double angle = low + place[a & 3] * wide;
        const double at = from + turn * (place[a >> 2 & 3] + (a >> 4)) / pieces;
        const struct kiln_dvec3 i = chart_direction(c, angle, at);
        if (i.z * c->side > 0.0)
            sum += share[a & 3] * share[a >> 2 & 3] * sin(angle) *
                   (double)kiln_bsdf_density(*l, o, vec3_of(i), KILN_LOBE_ALL);
        else
            *whole = false;
    }
    return sum * wide * turn / pieces;
}

/* How many standard deviations chi-squared of so many degrees of freedom lies above its mean (Wilson and Hilferty,
 * "The Distribution of Chi-square", PNAS 1931). */
static double deviations(double squared, int freedom)
{
    const double b = 2.0 / (9.0 * freedom);
    return (cbrt(squared / freedom) - (1.0 - b)) / sqrt(b);
}

struct fit {
    double deviations; /* of draws from densities */
    double total;      /* integral of the density, with the share of draws that end */
};

static struct fit test_draws(const struct kiln_bsdf_lobes *l, struct kiln_vec3 o, const struct chart charts[2])
{
    double wanted[CELLS + 1] = {0}, squared = 0.0, total = 0.0;
    unsigned found[CELLS + 1] = {0}, ended = 0;
    bool whole[CELLS];
    int freedom = 0;
    for (int k = 0; k < CELLS; k++) {
        wanted[k] = cell_probability(&charts[k / (CELLS / 2)], k % (CELLS / 2), l, o, &whole[k]) * DRAWS;
        total += wanted[k] / DRAWS;
    }
    for (unsigned k = 1; k <= DRAWS; k++) {
        const struct kiln_bsdf_drawn d = draw(l, o, k, INDEPENDENT, KILN_LOBE_ALL);
        const int half = (double)d.i.z * charts[0].side > 0.0 ? 0 : 1;
        if (d.density > 0.0f)
            found[half * (CELLS / 2) + chart_cell(&charts[half], d.i)]++;
        else
            ended++;
    }
    wanted[CELLS] = DRAWS; /* the rest in one */
    found[CELLS] = DRAWS;
    for (int k = 0; k < CELLS; k++)
        if (whole[k] && wanted[k] >= 10.0) {
            squared += (found[k] - wanted[k]) * (found[k] - wanted[k]) / wanted[k];
            wanted[CELLS] -= wanted[k];
            found[CELLS] -= found[k];
            freedom++;
        }
    if (wanted[CELLS] >= 10.0)
        squared += (found[CELLS] - wanted[CELLS]) * (found[CELLS] - wanted[CELLS]) / wanted[CELLS];
    return (struct fit){freedom < 2 ? 0.0 : deviations(squared, freedom), total + (double)ended / DRAWS};
}

static struct fit test_angle(const struct material *m, float alpha, float angle)
{
    const struct kiln_bsdf_lobes l = kiln_bsdf_prepare(white_material(m, alpha));
    const struct kiln_vec3 o = direction(angle, 0.3f, m->behind);
    struct kiln_vec3 beyond = vec3(-o.x, -o.y, -o.z);
    if (l.p.thin_wall == 0u) {
        const float eta = kiln_bsdf_eta(l.p, !m->behind).y, through = kiln_refracted_cosine(fabsf(o.z), eta);
        if (through > 0.0f)
            beyond = vec3(-o.x / eta, -o.y / eta, m->behind ? through : -through);
    }
    const double side = m->behind ? -1.0 : 1.0;
    const struct chart charts[2] = {chart_about(vec3(-o.x, -o.y, o.z), (double)alpha, side),
                                    chart_about(beyond, (double)alpha, -side)};
    return test_draws(&l, o, charts);
}

static void draws(void **state)
{
    (void)state;
    for (size_t i = 0; i < MATERIALS; i++) {
        if (!materials[i].draws)
            continue;
        double worst = 0.0, off = 0.0;
        const bool narrow = materials[i].anisotropy > 0.0f; /* lobes too narrow across for the cells, at first */
        for (int a = narrow ? ALPHAS / 2 : 0; a<ALPHAS; a += materials[i].coat> 0.0f ? 3 : 1)
            for (int b = 0; b < ANGLES; b++) {
                const struct fit fit = test_angle(&materials[i], alphas[a], degrees[b]);
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

static double apart(double a, double b) { return fabs(a - b) / fmax(fmax(fabs(a), fabs(b)), 1e-30); }

/* f(o, i) of radiance is f(i, o) of importance; over the squared indices both are one. */
static double reciprocity(const struct kiln_bsdf_lobes *l, struct kiln_vec3 o, const struct kiln_bsdf_drawn *d)
{
    const struct kiln_bsdf_value on = kiln_bsdf_evaluate(*l, o, d->i, KILN_RADIANCE, KILN_LOBE_ALL);
    const struct kiln_bsdf_value back = kiln_bsdf_evaluate(*l, d->i, o, KILN_IMPORTANCE, KILN_LOBE_ALL);
    const struct kiln_bsdf_value radiance = kiln_bsdf_evaluate(*l, d->i, o, KILN_RADIANCE, KILN_LOBE_ALL);
    const double there = fabs((double)d->i.z), here = fabs((double)o.z);
    const bool crosses = o.z * d->i.z < 0.0f && l->p.thin_wall == 0u;
    double off = 0.0;
    for (int c = 0; c < 3; c++) {
        const double eta = crosses ? (double)(&l->p.eta.x)[c] : 1.0,
                     squared = o.z > 0.0f ? eta * eta : 1.0 / (eta * eta);
        const double f = (double)(&on.value.x)[c] / there, g = (double)(&back.value.x)[c] / here;
        off = fmax(off, fmax(apart(f, g), apart(f * squared, (double)(&radiance.value.x)[c] / here)));
    }
    assert_true(apart((double)d->density, (double)on.density) < 1e-5);
    assert_true(apart((double)kiln_bsdf_reverse(*l, o, *d, KILN_LOBE_ALL), (double)back.density) < 1e-5);
    const struct kiln_bsdf_value drawn = kiln_bsdf_evaluate(*l, o, d->i, KILN_IMPORTANCE, KILN_LOBE_ALL);
    for (int c = 0; c < 3; c++)
        assert_true(apart((double)((&d->weight.x)[c] * d->density), (double)(&drawn.value.x)[c]) < 1e-5);
    return off;
}

static void reciprocities(void **state)
{
    (void)state;
    for (size_t i = 0; i < MATERIALS; i++) {
        double off = 0.0;
        for (int a = 0; a < ALPHAS; a++) {
            struct kiln_bsdf p = colored_material(&materials[i], alphas[a]);
            const struct kiln_bsdf_lobes l = kiln_bsdf_prepare(p);
            for (int b = 0; b < ANGLES; b++) {
                const struct kiln_vec3 o = direction(degrees[b], 0.3f, materials[i].behind);
                for (unsigned k = 1; k <= 64; k++) {
                    const struct kiln_bsdf_drawn d = draw(&l, o, k, EVEN, KILN_LOBE_ALL);
                    if (d.density > 0.0f && !d.delta)
                        off = fmax(off, reciprocity(&l, o, &d));
                }
            }
        }
        print_message("%s: reciprocity to %.1e\n", materials[i].name, off);
        assert_true(off < 1e-5);
    }
}

/* ---- known values ---- */

/* What the smooth face sends on to one side of light at normal incidence. */
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
            for (unsigned k = 1; k <= 64; k++) {
                const struct kiln_bsdf_drawn a = draw(&phong, o, k, EVEN, KILN_LOBE_ALL),
                                             b = draw(&facets, o, k, EVEN, KILN_LOBE_ALL);
                if (a.density > 0.0f)
                    assert_true(reciprocity(&phong, o, &a) < 1e-3); /* the power of a rounded cosine */
                if (b.density > 0.0f)
                    assert_true(reciprocity(&facets, o, &b) < 1e-5);
            }
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
    const struct CMUnitTest tests[] = {cmocka_unit_test(furnaces),      cmocka_unit_test(stored_diffuse),
                                       cmocka_unit_test(draws),         cmocka_unit_test(reciprocities),
                                       cmocka_unit_test(panes),         cmocka_unit_test(interfaces),
                                       cmocka_unit_test(nothing_there), cmocka_unit_test(dispersion),
                                       cmocka_unit_test(older_models),  cmocka_unit_test(shading_normals)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
