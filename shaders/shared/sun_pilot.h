/* Samples of a directional light under a sky. Nearly all places are wholly lit or wholly in shadow: there a few samples
 * suffice, and the others are better spent on the sky. At the edge of a shadow, however, this light causes most of the
 * noise. So in a scene with an environment, a pilot of a few rays decides how many samples the light gets at a point.
 * The point's other lights share the rest.
 *
 * The pilot uses separate random numbers, and its results are not part of the answer, which so stays unbiased (Kirk and
 * Arvo, "Unbiased Sampling Techniques for Image Synthesis", SIGGRAPH 1991). The first half of its rays starts at places
 * of the point. For the second half the distance of places from the point's centre is multiplied by 1 +
 * KILN_SUN_PILOT_BEYOND, to detect an edge that just touches the texel. */
#ifndef KILN_SHADERS_SHARED_SUN_PILOT_H
#define KILN_SHADERS_SHARED_SUN_PILOT_H

#include "shaders/shared/real.h"

#define KILN_SUN_PILOT_BEYOND 2.0f
/* The pilot finds a difference if the least light of its places is below this share of the greatest. */
#define KILN_SUN_SAME 0.75f
/* Factor of the light's samples, relative to its importance, where the pilot finds a difference. */
#define KILN_SUN_TIMES 3u

/* Number of pilot rays, even, of a point with `samples` samples in all. */
KILN_FUNCTION KILN_U32 kiln_sun_pilot(KILN_U32 samples) { return word_max(8u, word_min(samples / 4u, 64u)) / 2u * 2u; }

/* Number of samples of the light where the pilot finds no difference. */
KILN_FUNCTION KILN_U32 kiln_sun_few(KILN_U32 samples) { return word_max(4u, samples / 4u); }

/* Cost in samples of a pilot with few light samples. A light whose importance gives it no more than that has no pilot.
 */
KILN_FUNCTION KILN_U32 kiln_sun_least(KILN_U32 samples) { return kiln_sun_pilot(samples) + kiln_sun_few(samples); }

/* Number of samples left of `rest` after spending `spent`. */
KILN_FUNCTION KILN_U32 kiln_samples_left(KILN_U32 rest, KILN_U32 spent) { return rest - word_min(rest, spent); }

/* Rescales another choice's samples: it had `samples` of the `others` samples of all other choices, which now share
 * `rest`. */
KILN_FUNCTION KILN_U32 kiln_sun_other(KILN_U32 samples, KILN_U32 others, KILN_U32 rest)
{
    return word_max(1u, KILN_TO_U32((KILN_TO_U64(samples) * rest + others / 2u) / others));
}

/* Running sums that distribute a point's samples, choice by choice. Initially zero, but `samples` and `rest` are the
 * point's total. */
struct kiln_sun_sharing {
    KILN_U32 samples, rest; /* samples in all; samples not spent on directional lights and their pilots */
    KILN_U32 others;        /* of the other choices */
    bool any;               /* a light has a pilot: the other choices then have kiln_sun_other samples */
};

/* Adds a choice to the sums; `samples` is its number by importance. Returns whether it is a directional light with a
 * pilot. */
KILN_FUNCTION bool kiln_sun_asks(KILN_INOUT(KILN_STRUCT kiln_sun_sharing) s, bool is_sun, KILN_U32 samples)
{
    const KILN_U32 least = kiln_sun_least(KILN_AT(s).samples);
    const bool asks = is_sun && samples >= least;
    if (is_sun)
        KILN_AT(s).rest = kiln_samples_left(KILN_AT(s).rest, word_min(samples, least));
    else
        KILN_AT(s).others += samples;
    KILN_AT(s).any = KILN_AT(s).any || asks;
    return asks;
}

/* Number of samples of a directional light with a pilot; `differs`: the pilot found a difference. */
KILN_FUNCTION KILN_U32 kiln_sun_samples(KILN_IN(KILN_STRUCT kiln_sun_sharing) s, KILN_U32 samples, bool differs)
{
    return differs ? KILN_SUN_TIMES * samples : kiln_sun_few(KILN_AT(s).samples);
}

#endif
