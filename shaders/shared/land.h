/* The land pass (worker/pass/land.h): what both backends share of it. */
#ifndef KILN_SHADERS_SHARED_LAND_H
#define KILN_SHADERS_SHARED_LAND_H

#include "shaders/shared/random.h"

/* With the seed's upper half, in place of it: light paths draw other numbers than pixels. */
#define KILN_LAND_SEED 0x6c616e64u

/* The least chance of landing on the gloss of surface number `surface`, from 2 on: the first one is never landed on.
 * All of a path's mirrors together let it go on with a chance of 0.72 or more. Were the chance the same on each, light
 * by way of many would come by few paths of any weight. */
KILN_FUNCTION float kiln_land_least(KILN_U32 surface) { return 0.5f / (KILN_TO_F32(surface) * KILN_TO_F32(surface)); }

/* Returns the key of the random numbers of path k of an aim, but for the lower half of k. */
KILN_FUNCTION KILN_U32 kiln_land_key(KILN_U32 seed, KILN_U32 aim, KILN_U32 iteration_low, KILN_U32 iteration_high,
                                     KILN_U32 k_high)
{
    return kiln_hash2(kiln_hash2(seed, aim), kiln_hash2(kiln_hash2(iteration_low, iteration_high), k_high));
}

#endif
