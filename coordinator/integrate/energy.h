/* The energy ledger: where the lights' power went, in watts, by channel.
 *
 *   emitted = absorbed + glass + gloss + escaped + blocked + ranged + unfound + left over, within the estimated error.
 *
 * Tinted surfaces that light goes through take a part of it (glass); what they take of light that escapes or is blocked
 * in the end counts there. Mirrors, gloss and the bodies of glass take a part of what goes by way of them (gloss); of
 * what falls on a surface that is more than diffuse only what its diffuse part takes up is absorbed or reflected.
 *
 * Light that comes from lamps by way of mirrors, gloss and glass is unfound where a bake has no caustics, and as far as
 * gather rays cannot find it (kiln_emission_result.mirrored).
 *
 * The backs of double-sided surfaces have points like fronts; what meets the back of a single-sided surface is blocked,
 * and lost.
 *
 * Emission is traced from the lights (kiln_backend_emission), the direct pass gathers from the points' side, and a
 * gather pass knows both what it found (sum of area x incident) and, from the very same rays, what share of the
 * radiosity each point sends to nothing or to back faces (by reciprocity). So the two sides of the sum come from
 * different estimators, and a residual beyond the error means that something is wrong.
 *
 * An integrator whose points find all light by paths (integrate/reference) has in one step what bounces have in many:
 * the rays of its points say what becomes of the light that these send in all. Light of lamps without size that comes
 * by a mirror to its first diffuse surface is unfound where nothing is merged; what "bdpt" finds of its later bounces
 * is then left in the residual.
 *
 * `error` is that of chance. What texels are too coarse for is not in it.
 *
 * Sums over points are made in 128-bit fixed point, so that they do not depend on the order, the cells or the ranks. */
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
    /* the same number as (__int128)(value x per_unit), in one part or two of 64 bits, which the processor converts
     * itself */
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
/* A step so small that rounding 2^40 terms is below 1e-12 of `scale`, with room for sums up to 2^40 x `scale`. A power
 * of two that has an inverse. */
double kiln_exact_unit(double scale);
/* Collective: adds up `count` sums over all ranks; every rank gets the same bits. */
int kiln_exact_reduce(MPI_Comm communicator, struct kiln_exact_sum *sums, size_t count, struct kiln_error *error);

/* Energy of one step, summed over all points, W. */
struct kiln_step_energy {
    double incident[3];  /* sum of area x incident irradiance */
    double reflected[3]; /* sum of area x albedo x incident */
    double sent[3];      /* gather only: sum of area x radiosity gathered from */
    /* gather only: parts of `sent` that met nothing, or backs of single-sided surfaces */
    double escaped[3], blocked[3];
    double glass[3];   /* gather only: part of `sent` that tinted surfaces took on the way to where it landed */
    double gloss[3];   /* gather only: likewise mirrors, gloss and bodies of glass (struct kiln_point_result) */
    double unfound[3]; /* caustics: what light paths have found, and is left out as chance (land_pool.h) */
    double variance;   /* of the luminance of incident (+ escaped + blocked) */
};

/* Light that has met no diffuse surface before, W, by two estimators that share no more than the scene: as traced from
 * the lights, and as surface points found it. */
struct kiln_first_light {
    bool compared; /* points found it in steps of its own */
    double traced[3], found[3];
    double difference, error; /* luminance of found - traced; its standard error */
};

struct kiln_energy {
    double emitted[3], absorbed[3], glass[3], gloss[3], escaped[3], blocked[3], ranged[3], unfound[3], left_over[3];
    /* luminance of the part of `blocked` that should not be: without what suns and sky send to rooms' outsides, as far
     * as that goes without what their light does there once it has bounced, and to backs of what they light from both
     * sides */
    double lost;
    double residual; /* luminance of emitted - all the rest */
    double error;    /* its standard error, luminance */
    double relative; /* |residual| / luminance of emitted; 0 without lights */
    /* what came straight from the lights; and by mirrors, gloss and glass, less what is unfound */
    struct kiln_first_light straight, caustic;
    /* of `emitted`, what triangles with textures of emission or opacity send: by the textures' integrals; as samples
     * of the lamps found it, with its standard error, luminance */
    double textured[3], drawn[3], drawn_error;
};

#endif
