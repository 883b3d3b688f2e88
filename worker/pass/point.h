/* Results of the passes that light surface points (direct.h, gather.h): one struct for each point of a tile run. */
#ifndef KILN_WORKER_PASS_POINT_H
#define KILN_WORKER_PASS_POINT_H

#include <string.h>

#include "worker/pass/pass.h"

/* Sums over a point's samples, and how many samples these are: results of batches with different numbers of samples can
 * be added. kiln_point_mean divides. All zeros for a point that is not valid (kiln_point_valid): no sample is taken
 * there.
 *
 * The direct pass shares a point's samples out to several lights, each with its own part of them: there a sum is
 * `count` times the estimate of the mean.
 *
 * Sums are floats and must stay below 3.4e38: with radiance L and n samples pi L n must, which 1e25 W/(m2 sr) and 1e6
 * samples do. */
struct kiln_point_result {
    float irradiance[3]; /* about the shading normal, W/m2: the lightmap's quantity */
    float incident[3];   /* about the geometric normal, W/m2: what is absorbed or reflected */
    /* standard error of the sum of the luminances of `irradiance`, W/m2 (an upper estimate: from the spread of the
     * means of the four quarters of the samples); errors of batches add up by their squares */
    float error;
    float escaped; /* number of gather rays that met nothing (0 in the direct pass) */
    float blocked; /* number of gather rays that met the back of a single-sided surface (0 in the direct pass) */
    /* by colour: what tinted surfaces on the way take of what gather rays find, in rays; 0 without any */
    float glass[3];
    /* by colour: what mirrors, glass and gloss on the way take of what gather rays find, in rays
     * (shaders/shared/chain.h): what of a ray has neither escaped nor been blocked nor been taken up by a diffuse part.
     * It may be below 0, for points on what is metal or glass in part count too much as incident. 0 without any gloss,
     * and in the direct and the caustic pass */
    float gloss[3];
    /* no sum: mean opacity of the point (kiln_surface_opacity), the share of its area that is there to be lit; 1 for
     * opaque ones */
    float present;
    uint32_t count; /* samples */
};

/* Whether glass or gloss has taken anything. */
static inline bool kiln_point_is_tinted(const struct kiln_point_result *r)
{
    uint32_t bits[6], any = 0;
    memcpy(bits, r->glass, 3 * sizeof *bits);
    memcpy(bits + 3, r->gloss, 3 * sizeof *bits);
    for (int i = 0; i < 6; i++)
        any |= bits[i];
    return any != 0;
}

/* The same for one sample, on the average; all zeros where no sample was taken. */
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
