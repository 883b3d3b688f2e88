/* Results of the passes that light surface points (direct.h, gather.h): one struct for each point of a tile run. */
#ifndef KILN_WORKER_PASS_POINT_H
#define KILN_WORKER_PASS_POINT_H

#include <string.h>

#include "worker/pass/pass.h"

/* Sums over a point's samples, and their number, so that results of batches with different numbers of samples can be
 * added. kiln_point_mean divides. All zeros for a point that is not valid (kiln_point_valid): no sample is taken there.
 *
 * The direct pass shares a point's samples out to several lights, each with its own part of them: there a sum is
 * `count` times the estimate of the mean.
 *
 * Sums are floats and must stay below 3.4e38. With radiance L and n samples a sum is at most pi L n; 1e25 W/(m2 sr) and
 * 1e6 samples are safe. */
struct kiln_point_result {
    float irradiance[3]; /* about the shading normal, W/m2: the lightmap's quantity */
    float incident[3];   /* about the geometric normal, W/m2: what is absorbed or reflected */
    /* standard error of the sum of the luminances of `irradiance`, W/m2 (an upper estimate: from the spread of the
     * means of the four quarters of the samples); errors of batches add up by their squares */
    float error;
    float escaped; /* number of gather rays that met nothing (0 in the direct pass) */
    float blocked; /* number of gather rays that met the back of a single-sided surface (0 in the direct pass) */
    /* absorption by tinted surfaces, by colour, in rays: the share of the gather rays' light that they take on the way;
     * 0 without any */
    float glass[3];
    /* absorption by mirrors, glass and gloss, by colour, in rays (shaders/shared/chain.h): the share of rays that
     * neither escapes, nor is blocked, nor reaches a diffuse part. May be negative, since points on partly metallic or
     * glass surfaces count too much as incident. 0 without gloss, and in the direct and the caustic pass */
    float gloss[3];
    /* not a sum: mean opacity of the point (kiln_surface_opacity), the share of its area not cut out; 1 for opaque
     * points */
    float present;
    uint32_t count; /* samples */
};

/* Whether `glass` or `gloss` is not 0. */
static inline bool kiln_point_is_tinted(const struct kiln_point_result *r)
{
    uint32_t bits[6], any = 0;
    memcpy(bits, r->glass, 3 * sizeof *bits);
    memcpy(bits + 3, r->gloss, 3 * sizeof *bits);
    for (int i = 0; i < 6; i++)
        any |= bits[i];
    return any != 0;
}

/* Means over a point's samples; all zeros if no sample was taken. */
struct kiln_point_mean {
    float irradiance[3], incident[3];           /* W/m2 */
    float error;                                /* standard error of the luminance of `irradiance`, W/m2 */
    float escaped, blocked, glass[3], gloss[3]; /* shares of the gather rays, or of what they find */
    float present;
    uint32_t count; /* samples that the mean is of */
};

static inline struct kiln_point_mean kiln_point_mean(const struct kiln_point_result *r)
{
    struct kiln_point_mean mean = {.error = kiln_mean(r->error, r->count),
                                   .escaped = kiln_mean(r->escaped, r->count),
                                   .blocked = kiln_mean(r->blocked, r->count),
                                   .present = r->present,
                                   .count = r->count};
    for (int c = 0; c < 3; c++) { /* divisions are slow, and many the same */
        const bool same = memcmp(&r->irradiance[c], &r->incident[c], sizeof r->incident[c]) == 0;
        mean.incident[c] = kiln_mean(r->incident[c], r->count);
        mean.irradiance[c] = same ? mean.incident[c] : kiln_mean(r->irradiance[c], r->count);
    }
    if (kiln_point_is_tinted(r))
        for (int c = 0; c < 3; c++) {
            mean.glass[c] = kiln_mean(r->glass[c], r->count);
            mean.gloss[c] = kiln_mean(r->gloss[c], r->count);
        }
    return mean;
}

#endif
