/* Distribution of a point's samples over a GPU's threads. */
#ifndef KILN_SHADERS_SHARED_SLICES_H
#define KILN_SHADERS_SHARED_SLICES_H

#include "shaders/shared/language.h"

#define KILN_SLICE_WORTH 16u    /* least number of samples that justify a thread */
#define KILN_SLICES_ENOUGH 256u /* slices a quarter: beyond this slices get longer, as their sums take memory */
#define KILN_SLICE_ENOUGH 64u   /* samples a slice: beyond this there are more slices again, as each must end in time */
#define KILN_SLICES_MOST 1024u  /* maximum number of threads a quarter of the samples */

/* Each quarter of a point's samples is divided into `per_quarter` slices of `samples` each, one a thread. For a partly
 * buried point each slice is divided among `split` threads; `split` divides `samples`. The reason: a software device
 * ends a thread's loops after 65,535 rounds in all, which such a point needs for a dozen samples. (Slices are not that
 * small for all points, since such a device executes code at least once even where no thread has work.) */
struct kiln_slices {
    KILN_U32 samples, per_quarter, split;
};

KILN_FUNCTION KILN_STRUCT kiln_slices kiln_slices_of(KILN_U32 samples, bool software)
{
    const KILN_U32 quarter = (samples + 3u) / 4u, least = (quarter + KILN_SLICES_MOST - 1u) / KILN_SLICES_MOST,
                   worth = word_max(KILN_SLICE_WORTH, word_min(quarter / KILN_SLICES_ENOUGH, KILN_SLICE_ENOUGH)),
                   few = word_min(quarter, worth);
    KILN_STRUCT kiln_slices s;
    s.split = software && least < few ? (few + least - 1u) / least : 1u;
    s.samples = s.split > 1u ? s.split * least : word_max(least, few);
    s.per_quarter = (quarter + s.samples - 1u) / s.samples;
    return s;
}

#endif
