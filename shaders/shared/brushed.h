/* Tables of what brushed facets lose and reflect of light from a direction, made for a material
 * (worker/material/brushed.h); the same in C and GLSL.
 *
 * Facets that are rough along one axis and smooth along the other hardly change the component of a direction along the
 * smooth axis, y: so tables are over y, and over the cosine within the plane across it. The variables are
 *
 *     t = (1 - y^2)^(1/4)    0 along the smooth axis, 1 across it
 *     u = sqrt(|z| / sqrt(1 - y^2))
 *
 * From within the denser medium nothing gets out where y > 1 / index; what is lost bends there, and so t has a knot at
 * that place, `corner`, with more points below it. Between points values are linear in both.
 *
 * Where roughness has a texture there are several tables in a row, layers, one for each roughness of a grid that the
 * texture comes near to, with the means that lobes need. Between them values are those of the cubic polynomial through
 * four. */
#ifndef KILN_SHADERS_SHARED_BRUSHED_H
#define KILN_SHADERS_SHARED_BRUSHED_H

#include "shaders/shared/microfacet_albedo.h"

#define KILN_BRUSHED_T 33   /* points along t, */
#define KILN_BRUSHED_LOW 22 /* of which this one is at the corner, */
#define KILN_BRUSHED_U 25   /* and along u */

/* Values that a table has for each direction. */
#define KILN_BRUSHED_WHOLE 0   /* lost, were all reflected */
#define KILN_BRUSHED_FRESNEL 1 /* mean exact Fresnel reflectance, weighted by what facets reflect, from outside */
#define KILN_BRUSHED_THIN 2    /* glass: lost, reflected and refracted light together, from the thinner medium */
#define KILN_BRUSHED_DENSE 3   /* and from the denser one */
#define KILN_BRUSHED_HELD 4    /* kiln_bsdf_held */
#define KILN_BRUSHED_COAT 5    /* kiln_bsdf_coat_factor */
#define KILN_BRUSHED_VALUES 6

/* Layers stand at equal steps of the fourth root of the smaller alpha, 0.001 to 1: what hangs on light near the horizon
 * changes with alpha over the cosine. */
#define KILN_BRUSHED_LAYERS 13
#define KILN_BRUSHED_LEAST 0.177827941f /* the root of 0.001 */
KILN_FUNCTION float kiln_brushed_layer(float alpha)
{
    const float root = float_sqrt(float_sqrt(alpha)), least = KILN_BRUSHED_LEAST;
    return float_max(root - least, 0.0f) * (KILN_TO_F32(KILN_BRUSHED_LAYERS - 1) / (1.0f - least));
}

/* Means that a table has for the lobes that use it. */
struct kiln_brushed_means {
    float lost, glass_front, glass_back, glass_coat, held; /* the members of struct kiln_bsdf_lobes */
    /* Light that the coat lets in, on both sides; this times what facets keep; and this times their Fresnel share
     * (kiln_fresnel_share). By them the matt layer gets its light, whatever its specular colour is. */
    float in_front, kept_front, share_front, in_back, kept_back, share_back;
    KILN_STRUCT kiln_curve face_lost, face_effective; /* struct kiln_interface, mean over the azimuth */
};

struct kiln_brushed_table {
    float corner;
    float first, last; /* of layers: the grid's places of the first and the last; the same where there is one */
    KILN_STRUCT kiln_brushed_means means;                            /* of layers */
    float at[KILN_BRUSHED_VALUES * KILN_BRUSHED_T * KILN_BRUSHED_U]; /* of t, of u, of the values above */
};

#define KILN_BRUSHED_BYTES 19928u

#ifdef KILN_GLSL
KILN_ARRAY(BrushedTables, kiln_brushed_table, 4);
#    define KILN_BRUSHED_THERE (HAS_BRUSHED != 0u)
#    define KILN_BRUSHED_TABLE(low, high, next) BrushedTables(packUint2x32(uvec2(low, high))).at[next]
#else
_Static_assert(sizeof(struct kiln_brushed_table) == KILN_BRUSHED_BYTES, "a table of brushed facets");
#    define KILN_BRUSHED_THERE true
#    define KILN_BRUSHED_TABLE(low, high, next)                                                                        \
        (((const struct kiln_brushed_table *)(uintptr_t)((uint64_t)(high) << 32 | (uint64_t)(low)))[next])
#endif

/* The address of the layer so many after another. */
KILN_FUNCTION void kiln_brushed_step(KILN_U32 low, KILN_U32 high, KILN_I32 layers, KILN_OUT(KILN_U32) to_low,
                                     KILN_OUT(KILN_U32) to_high)
{
    const KILN_U32 sum = low + KILN_TO_U32(layers) * KILN_BRUSHED_BYTES;
    KILN_AT(to_high) = sum < low ? high + 1u : high;
    KILN_AT(to_low) = sum;
}

/* t at a place, 0 to KILN_BRUSHED_T - 1, and back. */
KILN_FUNCTION float kiln_brushed_place(float t, float corner)
{
    const float low = KILN_TO_F32(KILN_BRUSHED_LOW), all = KILN_TO_F32(KILN_BRUSHED_T - 1);
    return t < corner ? low * (t / corner) : low + (all - low) * ((t - corner) / (1.0f - corner));
}
KILN_FUNCTION float kiln_brushed_t(float place, float corner)
{
    const float low = KILN_TO_F32(KILN_BRUSHED_LOW), all = KILN_TO_F32(KILN_BRUSHED_T - 1);
    return place < low ? corner * (place / low) : corner + (1.0f - corner) * ((place - low) / (all - low));
}

/* Weight of the value at `layer`, 0 to 3, in the cubic polynomial through the values at all four, at x. */
KILN_FUNCTION float kiln_brushed_weight(KILN_I32 layer, float x)
{
    const float half_ = 0.5f * x * (x - 3.0f);
    if (layer == 0 || layer == 3)
        return KILN_RATIO32(1, 6) * (x - 1.0f) * (x - 2.0f) * (layer == 0 ? 3.0f - x : x);
    return layer == 1 ? half_ * (x - 2.0f) : half_ * (1.0f - x);
}

/* The value at point k of the table `next`, and a and b of the way to the next points along t and u. */
KILN_FUNCTION float kiln_brushed_between(KILN_U32 address_low, KILN_U32 address_high, KILN_I32 next, KILN_I32 k,
                                         float a, float b)
{
    const KILN_I32 along = KILN_BRUSHED_VALUES, row = KILN_BRUSHED_U * KILN_BRUSHED_VALUES;
    const float here = (1.0f - b) * KILN_BRUSHED_TABLE(address_low, address_high, next).at[k] +
                       b * KILN_BRUSHED_TABLE(address_low, address_high, next).at[k + along];
    const float there = (1.0f - b) * KILN_BRUSHED_TABLE(address_low, address_high, next).at[k + row] +
                        b * KILN_BRUSHED_TABLE(address_low, address_high, next).at[k + row + along];
    return (1.0f - a) * here + a * there;
}

/* The table's value KILN_BRUSHED_... of a unit direction; its components are `rough` along the rough axis and z along
 * the normal. The table's address is in two words; `part` of the way from the first of four layers on. */
KILN_FUNCTION float kiln_brushed_at(KILN_U32 address_low, KILN_U32 address_high, float part, float rough, float z,
                                    KILN_I32 value)
{
    const float across = float_sqrt(rough * rough + z * z), last = KILN_TO_F32(KILN_BRUSHED_U - 1);
    const float u = last * float_min(float_sqrt(float_abs(z) / float_max(across, KILN_FLOAT_TINY)), 1.0f);
    const float p = kiln_brushed_place(float_min(float_sqrt(across), 1.0f),
                                       KILN_BRUSHED_TABLE(address_low, address_high, 0).corner);
    const KILN_I32 i = KILN_TO_I32(float_min(p, KILN_TO_F32(KILN_BRUSHED_T - 2)));
    const KILN_I32 j = KILN_TO_I32(float_min(u, last - 1.0f));
    const float a = float_min(p - KILN_TO_F32(i), 1.0f), b = u - KILN_TO_F32(j);
    const KILN_I32 k = (i * KILN_BRUSHED_U + j) * KILN_BRUSHED_VALUES + value;
    const KILN_I32 layers = part == 0.0f ? 1 : 4; /* not known to compilers, which would write the loop out */
    float sum = 0.0f;
    for (KILN_I32 layer = 0; layer < layers; layer++)
        sum += (layers == 1 ? 1.0f : kiln_brushed_weight(layer, part)) *
               kiln_brushed_between(address_low, address_high, layer, k, a, b);
    if (layers == 1)
        return sum;
    return float_max(value == KILN_BRUSHED_FRESNEL ? float_min(sum, 1.0f) : sum, 0.0f);
}

#endif
