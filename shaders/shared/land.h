/* Code of the land pass (worker/pass/land.h) common to both backends. */
#ifndef KILN_SHADERS_SHARED_LAND_H
#define KILN_SHADERS_SHARED_LAND_H

#include "shaders/shared/random.h"

/* Combined with the upper half of the seed, so that light paths draw other random numbers than pixels. */
#define KILN_LAND_SEED 0x6c616e64u

/* Minimum probability of landing on the gloss of surface number `surface`, from 2 on; paths never land on the first. It
 * falls with the number, so that the mirrors of a path together let it continue with a probability of at least 0.72. A
 * constant minimum would leave light via many mirrors to few paths of large weight. */
KILN_FUNCTION float kiln_land_least(KILN_U32 surface) { return 0.5f / (KILN_TO_F32(surface) * KILN_TO_F32(surface)); }

/* Returns the key of the random numbers of path k of an aim; the lower half of k is to be added by the caller. */
KILN_FUNCTION KILN_U32 kiln_land_key(KILN_U32 seed, KILN_U32 aim, KILN_U32 iteration_low, KILN_U32 iteration_high,
                                     KILN_U32 k_high)
{
    return kiln_hash2(kiln_hash2(seed, aim), kiln_hash2(kiln_hash2(iteration_low, iteration_high), k_high));
}

#endif
