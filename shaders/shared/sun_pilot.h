/* Samples of a directional light under a sky. Nearly all places are either lit or shadowed by such a light as a whole,
 * which a few samples say as well as many, and there the samples are better spent on the sky; but at an edge of a
 * shadow its noise is that of the picture. So where a scene has an environment, a pilot of a few rays decides how many
 * samples the light has at a point, and the point's other lights share what is left.
 *
 * The pilot's numbers are its own and nothing of it goes into the answer, which so stays without bias (Kirk and Arvo,
 * "Unbiased Sampling Techniques for Image Synthesis", SIGGRAPH 1991). Its first half starts at places of the point, its
 * second half at such places with their distance from the point's centre times 1 + KILN_SUN_PILOT_BEYOND, for an edge
 * that just touches the texel. */
#ifndef KILN_SHADERS_SHARED_SUN_PILOT_H
#define KILN_SHADERS_SHARED_SUN_PILOT_H

#include "shaders/shared/real.h"

#define KILN_SUN_PILOT_BEYOND 2.0f
/* The light of the pilot's places differs where the least is less than so much of the most. */
#define KILN_SUN_SAME 0.75f
/* There the light has so many times the samples that its importance gives it. */
#define KILN_SUN_TIMES 3u

/* Rays of the pilot of a point that has so many samples in all; even. */
KILN_FUNCTION KILN_U32 kiln_sun_pilot(KILN_U32 samples) { return word_max(8u, word_min(samples / 4u, 64u)) / 2u * 2u; }

/* Samples of the light where the pilot finds no difference. */
KILN_FUNCTION KILN_U32 kiln_sun_few(KILN_U32 samples) { return word_max(4u, samples / 4u); }

/* Samples that a pilot and few samples cost. A light that has no more than that by its importance keeps its own. */
KILN_FUNCTION KILN_U32 kiln_sun_least(KILN_U32 samples) { return kiln_sun_pilot(samples) + kiln_sun_few(samples); }

/* Samples left of `rest` after `spent` more. */
KILN_FUNCTION KILN_U32 kiln_samples_left(KILN_U32 rest, KILN_U32 spent) { return rest - word_min(rest, spent); }

/* Samples of another choice that had so many of the `others` samples of all of them, when `rest` are left. */
KILN_FUNCTION KILN_U32 kiln_sun_other(KILN_U32 samples, KILN_U32 others, KILN_U32 rest)
{
    return word_max(1u, KILN_TO_U32((KILN_TO_U64(samples) * rest + others / 2u) / others));
}

/* How a point's samples are shared out, choice by choice; zero but for `samples` and `rest`, which are those of all. */
struct kiln_sun_sharing {
    KILN_U32 samples, rest; /* in all; not spent on directional lights and their pilots */
    KILN_U32 others;        /* of the other choices */
    bool any;               /* some light has a pilot: the other choices have kiln_sun_other then */
};

/* Takes a choice with so many samples by its importance. Whether it is a directional light with a pilot. */
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

/* The samples of such a choice, whose light differs around the point or does not. */
KILN_FUNCTION KILN_U32 kiln_sun_samples(KILN_IN(KILN_STRUCT kiln_sun_sharing) s, KILN_U32 samples, bool differs)
{
    return differs ? KILN_SUN_TIMES * samples : kiln_sun_few(KILN_AT(s).samples);
}

#endif
