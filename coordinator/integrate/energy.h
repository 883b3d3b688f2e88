/* The energy ledger: balance of the lights' power, in watts, by channel.
 *
 *   emitted = absorbed + glass + gloss + escaped + blocked + ranged + unfound + left over, within the estimated error.
 *
 * Tinted surfaces absorb a part of the light that passes through them (glass); if the light finally escapes or is
 * blocked, this part counts there. Mirrors, gloss and the bodies of glass absorb a part of the light that goes by way
 * of them (gloss). On a surface that is not purely diffuse, only the light for its diffuse part counts as absorbed or
 * reflected.
 *
 * Light that comes from lamps by way of mirrors, gloss and glass is unfound if a bake has no caustics, and as far as
 * gather rays cannot find it (kiln_emission_result.mirrored).
 *
 * The backs of double-sided surfaces have points like fronts; light on the back of a single-sided surface is blocked,
 * and lost.
 *
 * Emission is traced from the lights (kiln_backend_emission), and the direct pass gathers at the points. A gather pass
 * knows both the light that it found (sum of area x incident) and, from the same rays, the fraction of each point's
 * radiosity that goes to nothing or to back faces (by reciprocity). So the two sides of the balance come from different
 * estimators, and a residual beyond the error indicates a fault.
 *
 * An integrator whose points find all light by paths (integrate/reference) does in one step what bounces do in many:
 * the rays of its points determine the fate of all light that these send. Light of lamps without size that
 * reaches its first diffuse surface by a mirror is unfound if nothing is merged; its later bounces, as far as "bdpt"
 * finds them, stay in the residual.
 *
 * `error` is the statistical error. It does not include errors of too coarse texels.
 *
 * Sums over points use 128-bit fixed point, so that they do not depend on the order, the cells or the ranks. */
#ifndef KILN_COORDINATOR_INTEGRATE_ENERGY_H
#define KILN_COORDINATOR_INTEGRATE_ENERGY_H

#include <math.h>
#include <mpi.h>
#include <stdbool.h>

#include "worker/backend/backend.h"
#include "worker/base/color.h"

enum { KILN_EMISSION_SAMPLES = 1 << 18 }; /* particles that are traced from the lights */

/* A sum of doubles that does not depend on their order. */
struct kiln_exact_sum {
    __int128 value;
};

/* `per_unit`: 1 / the value of one step of the fixed point (kiln_exact_unit), a power of two. */
static inline void kiln_exact_add(struct kiln_exact_sum *sum, double value, double per_unit)
{
    /* equals (__int128)(value x per_unit), computed in one or two parts of 64 bits, which the processor converts itself
     */
    const double steps = value * per_unit;
    if (fabs(steps) < 0x1p62) {
        sum->value += (int64_t)steps;
        return;
    }
    const int64_t high = (int64_t)(steps * 0x1p-40);
    sum->value += ((__int128)high * ((int64_t)1 << 40)) + (int64_t)(steps - (double)high * 0x1p40);
}
static inline double kiln_exact_value(const struct kiln_exact_sum *sum, double unit)
{
    return (double)sum->value * unit;
}
/* Computes the fixed-point step: so small that rounding 2^40 terms stays below 1e-12 of `scale`, with room for sums up
 * to 2^40 x `scale`. It is a power of two that has an inverse. */
double kiln_exact_unit(double scale);
/* Collective: adds up `count` sums over all ranks; every rank gets the same bits. */
int kiln_exact_reduce(MPI_Comm communicator, struct kiln_exact_sum *sums, size_t count, struct kiln_error *error);

/* Energy of one step, summed over all points, W. */
struct kiln_step_energy {
    double incident[3];  /* sum of area x incident irradiance */
    double reflected[3]; /* sum of area x albedo x incident */
    double sent[3];      /* gather only: sum of area x radiosity gathered from */
    /* gather only: parts of `sent` that hit nothing, or backs of single-sided surfaces */
    double escaped[3], blocked[3];
    double glass[3];   /* gather only: part of `sent` that tinted surfaces absorbed on its way */
    double gloss[3];   /* gather only: part absorbed by mirrors, gloss, bodies of glass (struct kiln_point_result) */
    double unfound[3]; /* caustics: light of paths that is left out as noise (land_pool.h) */
    double variance;   /* of the luminance of incident (+ escaped + blocked) */
};

/* Light that has not met a diffuse surface before, W, from two estimators that share only the scene: traced from the
 * lights, and found at surface points. */
struct kiln_first_light {
    bool compared; /* points found this light in separate steps */
    double traced[3], found[3];
    double difference, error; /* luminance of found - traced; its standard error */
};

struct kiln_energy {
    double emitted[3], absorbed[3], glass[3], gloss[3], escaped[3], blocked[3], ranged[3], unfound[3], left_over[3];
    /* luminance of the part of `blocked` that should not exist. Not counted: light of suns and sky on rooms' outsides,
     * their bounced light there as far as it can be separated, and their light on backs of surfaces lit from both sides
     */
    double lost;
    double residual; /* luminance of emitted - all the rest */
    double error;    /* its standard error, luminance */
    double relative; /* |residual| / luminance of emitted; 0 without lights */
    /* direct light; and light by way of mirrors, gloss and glass, without the unfound part */
    struct kiln_first_light straight, caustic;
    /* part of `emitted` from triangles with textures of emission or opacity: by the textures' integrals; by samples of
     * the lamps, with their standard error, luminance */
    double textured[3], drawn[3], drawn_error;
};

#endif
