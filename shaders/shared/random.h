/* Random numbers, the same integers in C and GLSL.
 *
 * Every number is a function of (seed, object, texel, stream, sample, dimension). A sample is a point of Sobol'
 * sequence, Owen-scrambled per tile by a hash in the manner of Laine and Karras ("Stratified Sampling for Stochastic
 * Transparency", 2011; Burley, "Practical Hash-based Owen Scrambling", 2020; constants of Vegdahl, 2021), then shifted
 * digitally per texel. In the dimensions that choose a ray's direction the shift leaves the leading digits alone, so
 * that the k-th rays of all texels of a tile share a stratum; with 4^c <= samples, c shared digits a dimension, each
 * texel still visits all 4^c strata equally often, and sharing adds no noise (the mean over a stratum does not depend
 * on the shared scramble). shaders/shared/streams.h lists what each number depends on. */
#ifndef KILN_SHADERS_RANDOM_H
#define KILN_SHADERS_RANDOM_H

#include "shaders/shared/language.h"

/* Avalanching hash of one word (Wang-style mixer "lowbias32" by Wellons, 2018: bias 0.17 of 2^-32 squared units). */
KILN_FUNCTION KILN_U32 kiln_hash1(KILN_U32 x)
{
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x;
}

KILN_FUNCTION KILN_U32 kiln_hash2(KILN_U32 a, KILN_U32 b)
{
    return kiln_hash1(a ^ (kiln_hash1(b) + 0x9e3779b9u + (a << 6) + (a >> 2)));
}

#ifdef KILN_GLSL
#    define kiln_reverse_bits bitfieldReverse
#else
KILN_FUNCTION KILN_U32 kiln_reverse_bits(KILN_U32 x)
{
    x = (x >> 1 & 0x55555555u) | (x & 0x55555555u) << 1;
    x = (x >> 2 & 0x33333333u) | (x & 0x33333333u) << 2;
    x = (x >> 4 & 0x0f0f0f0fu) | (x & 0x0f0f0f0fu) << 4;
    x = (x >> 8 & 0x00ff00ffu) | (x & 0x00ff00ffu) << 8;
    return x >> 16 | x << 16;
}
#endif

/* Owen scramble of a fraction x / 2^32: each digit is flipped by a hash of the digits above it. */
KILN_FUNCTION KILN_U32 kiln_owen_scramble(KILN_U32 x, KILN_U32 seed)
{
    x = kiln_reverse_bits(x);
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return kiln_reverse_bits(x);
}

/* Number of leading binary digits a dimension that the texels of a tile may share: the largest c with 4^c <= samples.
 */
KILN_FUNCTION KILN_U32 kiln_shared_digits(KILN_U32 samples)
{
    KILN_U32 c = 0u;
    while (c < 8u && (samples >> (2u * (c + 1u))) != 0u)
        c++;
    return c;
}

#endif
