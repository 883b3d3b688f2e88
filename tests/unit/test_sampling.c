/* Tests of random numbers: net property, scrambling, shared strata, warps. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>

#include "shaders/shared/path.h"
#include "shaders/shared/random.h"
#include "worker/sampling/harmonics.h"
#include "worker/sampling/sequence.h"

/* Every elementary interval of 1/256 of the square holds exactly one of 256 points, also after scrambling and shifting.
 */
static void check_net(const uint32_t *x, const uint32_t *y)
{
    for (uint32_t bits = 0; bits <= 8; bits++) {
        uint8_t seen[256] = {0};
        for (uint32_t k = 0; k < 256; k++) {
            const uint32_t column = bits == 0 ? 0 : x[k] >> (32 - bits), row = bits == 8 ? 0 : y[k] >> (24 + bits);
            seen[(column << (8 - bits)) + row]++;
        }
        for (int i = 0; i < 256; i++)
            assert_int_equal(seen[i], 1);
    }
}

/* Points 0 .. count-1 of one dimension, Owen-scrambled with `seed`. */
static void scramble(uint32_t *points, uint32_t count, uint32_t dimension, uint32_t seed)
{
    for (uint32_t k = 0; k < count; k++)
        points[k] = kiln_owen_scramble(kiln_sobol(k, dimension), seed);
}

static void first_two_dimensions_are_a_net(void **state)
{
    (void)state;
    uint32_t x[256], y[256];
    for (uint32_t k = 0; k < 256; k++) {
        x[k] = kiln_sobol(k, 0);
        y[k] = kiln_sobol(k, 1);
    }
    check_net(x, y);
    scramble(x, 256, 0, 12345);
    scramble(y, 256, 1, 67890);
    check_net(x, y);
    for (int k = 0; k < 256; k++) {
        x[k] ^= 0xdeadbeefu;
        y[k] ^= 0x12345678u >> 4;
    }
    check_net(x, y);
}

/* The recurrence of Joe and Kuo, from their numbers for dimensions 2 to 5. */
static void directions_follow_the_recurrence(void **state)
{
    (void)state;
    static const struct {
        uint32_t degree, coefficients, initial[3];
    } polynomials[KILN_DIMENSIONS] = {{0, 0, {0}}, {1, 0, {1}}, {2, 1, {1, 3}}, {3, 1, {1, 3, 1}}, {3, 2, {1, 1, 1}}};
    for (uint32_t d = 1; d < KILN_DIMENSIONS; d++) {
        uint32_t v[32];
        const uint32_t s = polynomials[d].degree;
        for (uint32_t i = 0; i < 32; i++) {
            v[i] = i < s ? polynomials[d].initial[i] << (31 - i) : v[i - s] ^ (v[i - s] >> s);
            for (uint32_t k = 1; i >= s && k < s; k++)
                v[i] ^= (polynomials[d].coefficients >> (s - 1 - k) & 1u) * v[i - k];
            assert_int_equal(kiln_sobol(1u << i, d), v[i]);
        }
    }
}

/* The k-th samples of all texels of a tile lie in one stratum, and each texel visits all strata. */
static void texels_share_strata(void **state)
{
    (void)state;
    const uint32_t samples = 64, digits = kiln_shared_digits(samples);
    assert_int_equal(digits, 3);
    uint32_t x[64], y[64], visited[64] = {0};
    scramble(x, samples, 0, 1);
    scramble(y, samples, 1, 2);
    for (uint32_t k = 0; k < samples; k++) {
        const uint32_t stratum = (x[k] >> 29) * 8 + (y[k] >> 29);
        visited[stratum]++;
        for (uint32_t texel = 0; texel < 16; texel++) {
            const uint32_t u = x[k] ^ kiln_direction_shift(kiln_hash1(texel), KILN_DIMENSION_U, digits);
            const uint32_t v = y[k] ^ kiln_direction_shift(kiln_hash1(texel), KILN_DIMENSION_V, digits);
            assert_int_equal((u >> 29) * 8 + (v >> 29), stratum);
        }
    }
    for (int i = 0; i < 64; i++)
        assert_int_equal(visited[i], 1);
}

static void shared_digits_never_exceed_the_samples(void **state)
{
    (void)state;
    for (uint32_t n = 1; n < 100000; n = n * 3 / 2 + 1) {
        const uint32_t c = kiln_shared_digits(n);
        assert_true(c == 0 || (1ull << (2 * c)) <= n);
    }
}

static void cosine_direction_has_the_right_moments(void **state)
{
    (void)state;
    double z = 0.0, z2 = 0.0, x = 0.0;
    const uint32_t n = 4096;
    for (uint32_t k = 0; k < n; k++) {
        const struct kiln_dvec3 d =
            kiln_cosine_direction(kiln_unit_double(kiln_sobol(k, 0)), kiln_unit_double(kiln_sobol(k, 1)));
        assert_true(fabs(dvec3_length(d) - 1.0) < 1e-12);
        z += d.z / n;
        z2 += d.z * d.z / n;
        x += d.x / n;
    }
    assert_true(fabs(z - 2.0 / 3.0) < 5e-4); /* mean cosine 2/3, mean squared cosine 1/2 */
    assert_true(fabs(z2 - 0.5) < 5e-4);
    assert_true(fabs(x) < 1e-4);
}

static void harmonics_are_orthonormal(void **state)
{
    (void)state;
    double gram[KILN_HARMONICS][KILN_HARMONICS] = {{0}};
    const uint32_t n = 1 << 14;
    for (uint32_t k = 0; k < n; k++) {
        double y[KILN_HARMONICS];
        kiln_harmonics(kiln_sphere_direction(kiln_unit_double(kiln_sobol(k, 0)), kiln_unit_double(kiln_sobol(k, 1))),
                       y);
        for (int i = 0; i < KILN_HARMONICS; i++)
            for (int j = 0; j < KILN_HARMONICS; j++)
                gram[i][j] += y[i] * y[j] * 4.0 * KILN_PI / n;
    }
    for (int i = 0; i < KILN_HARMONICS; i++)
        for (int j = 0; j < KILN_HARMONICS; j++)
            assert_true(fabs(gram[i][j] - (i == j)) < 1e-3);
}

static void basis_is_orthonormal(void **state)
{
    (void)state;
    for (uint32_t k = 0; k < 1000; k++) {
        const struct kiln_vec3 n =
            vec3_of(kiln_sphere_direction(kiln_unit_double(kiln_sobol(k, 0)), kiln_unit_double(kiln_sobol(k, 1))));
        struct kiln_vec3 t, b;
        kiln_basis(n, &t, &b);
        assert_true(fabsf(vec3_dot(t, n)) < 1e-6f && fabsf(vec3_dot(b, n)) < 1e-6f && fabsf(vec3_dot(t, b)) < 1e-6f);
        const struct kiln_vec3 c = vec3_cross(t, b);
        assert_true(vec3_dot(c, n) > 0.99999f);
    }
}

/* Sobol' points that are computed are those of the table, and what paths make of them are nets, of each aligned power
 * of two of the samples, that tell nothing of each other. */
static void paths_draw_nets(void **state)
{
    (void)state;
    for (uint32_t k = 0; k < 5000; k++)
        assert_int_equal(kiln_path_sobol_second(k * 65537u), kiln_sobol(k * 65537u, 1));
    for (uint32_t first = 0; first < 1024; first += 256) {
        uint32_t x[256], y[256], other[256], rest;
        uint32_t joint[16] = {0};
        for (uint32_t k = 0; k < 256; k++) {
            kiln_path_numbers(kiln_path_key(7u, 1u), first + k, &x[k], &y[k]);
            kiln_path_numbers(kiln_path_key(7u, 2u), first + k, &other[k], &rest);
            joint[(x[k] >> 30) * 4 + (other[k] >> 30)]++;
        }
        check_net(x, y);
        for (int i = 0; i < 16; i++) /* 16 of 256 on the average */
            assert_in_range(joint[i], 4, 36);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(directions_follow_the_recurrence),
        cmocka_unit_test(first_two_dimensions_are_a_net),
        cmocka_unit_test(texels_share_strata),
        cmocka_unit_test(shared_digits_never_exceed_the_samples),
        cmocka_unit_test(cosine_direction_has_the_right_moments),
        cmocka_unit_test(harmonics_are_orthonormal),
        cmocka_unit_test(basis_is_orthonormal),
        cmocka_unit_test(paths_draw_nets),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
