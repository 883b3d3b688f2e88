#include "worker/sampling/sequence.h"

#include <assert.h>

#include "shaders/random.h"

/* Direction numbers of new-joe-kuo-6.21201, dimensions 2 to 5: degree s, coefficients a, initial m. */
struct sobol_polynomial {
    uint32_t degree, coefficients, initial[3];
};
static const struct sobol_polynomial polynomials[KILN_DIMENSIONS] = {
    {0, 0, {0, 0, 0}}, {1, 0, {1, 0, 0}}, {2, 1, {1, 3, 0}}, {3, 1, {1, 3, 1}}, {3, 2, {1, 1, 1}},
};

static void direction_numbers(uint32_t dimension, uint32_t v[32])
{
    const struct sobol_polynomial *p = &polynomials[dimension];
    for (uint32_t i = 0; i < 32; i++) {
        if (dimension == 0) {
            v[i] = 1u << (31 - i);
        } else if (i < p->degree) {
            v[i] = p->initial[i] << (31 - i);
        } else {
            v[i] = v[i - p->degree] ^ (v[i - p->degree] >> p->degree);
            for (uint32_t k = 1; k < p->degree; k++)
                v[i] ^= (p->coefficients >> (p->degree - 1 - k) & 1u) * v[i - k];
        }
    }
}

uint32_t kiln_sobol(uint32_t index, uint32_t dimension)
{
    assert(dimension < KILN_DIMENSIONS);
    uint32_t v[32], x = 0;
    direction_numbers(dimension, v);
    for (uint32_t i = 0; index != 0; i++, index >>= 1)
        x ^= (index & 1u) * v[i];
    return x;
}

void kiln_sobol_scrambled(uint32_t *points, uint32_t count, uint32_t dimension, uint32_t seed)
{
    assert(dimension < KILN_DIMENSIONS);
    uint32_t v[32];
    direction_numbers(dimension, v);
    for (uint32_t k = 0; k < count; k++) {
        uint32_t x = 0;
        for (uint32_t i = 0, rest = k; rest != 0; i++, rest >>= 1)
            x ^= (rest & 1u) * v[i];
        points[k] = kiln_owen_scramble(x, seed);
    }
}

struct kiln_dvec3 kiln_sphere_direction(double u, double v)
{
    const double z = 1.0 - 2.0 * u, r = sqrt(fmax(0.0, 1.0 - z * z)), phi = 2.0 * KILN_PI * v;
    return dvec3(r * cos(phi), r * sin(phi), z);
}

struct kiln_dvec3 kiln_cosine_direction(double u, double v)
{
    const double r = sqrt(u), phi = 2.0 * KILN_PI * v;
    return dvec3(r * cos(phi), r * sin(phi), sqrt(fmax(0.0, 1.0 - u)));
}
