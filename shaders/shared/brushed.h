/* Tables of the energy that anisotropic (brushed) microfacets lose and reflect, by direction of the light; made for a
 * material (worker/material/brushed.h); the same in C and GLSL.
 *
 * Facets that are rough along one axis and smooth along the other hardly change the component y of a direction along
 * the smooth axis. So the tables are functions of y, and of the cosine in the plane perpendicular to it. The variables
 * are
 *
 *     t = (1 - y^2)^(1/4)    0 along the smooth axis, 1 across it
 *     u = sqrt(|z| / sqrt(1 - y^2))
 *
 * From within the denser medium there is total reflection for y > 1 / index. The loss has a kink there, so the grid in
 * t has a knot at that value, `corner`, with more points below it. Between points, values are linear in t and u.
 *
 * If the roughness has a texture, a material has several consecutive tables, called layers, one for each roughness of a
 * grid over the range of the texture, with the means that lobes need. Between layers, values are interpolated by the
 * cubic polynomial through four of them. */
#ifndef KILN_SHADERS_SHARED_BRUSHED_H
#define KILN_SHADERS_SHARED_BRUSHED_H

#include "shaders/shared/microfacet_albedo.h"

#define KILN_BRUSHED_T 33   /* points along t, */
#define KILN_BRUSHED_LOW 22 /* of which this one is at the corner, */
#define KILN_BRUSHED_U 25   /* and along u */

/* Values that a table has for each direction. */
#define KILN_BRUSHED_WHOLE 0   /* fraction lost by perfectly reflecting facets */
#define KILN_BRUSHED_FRESNEL 1 /* mean exact Fresnel reflectance, weighted by the facets' reflection, from outside */
#define KILN_BRUSHED_THIN 2    /* fraction lost by glass, reflection and refraction, from the thinner medium */
#define KILN_BRUSHED_DENSE 3   /* fraction lost by glass, reflection and refraction, from the denser medium */
#define KILN_BRUSHED_TRAPPED 4 /* kiln_bsdf_trapped */
#define KILN_BRUSHED_COAT 5    /* kiln_bsdf_coat_factor */
#define KILN_BRUSHED_VALUES 6

/* Layers are at equal steps of the fourth root of the smaller alpha, 0.001 to 1: quantities that depend on light near
 * the horizon vary with alpha / cosine. kiln_brushed_layer gives the layer coordinate of an alpha. */
#define KILN_BRUSHED_LAYERS 13
#define KILN_BRUSHED_LEAST 0.177827941f /* the root of 0.001 */
KILN_FUNCTION float kiln_brushed_layer(float alpha)
{
    const float root = float_sqrt(float_sqrt(alpha)), least = KILN_BRUSHED_LEAST;
    return float_max(root - least, 0.0f) * (KILN_TO_F32(KILN_BRUSHED_LAYERS - 1) / (1.0f - least));
}

/* Means that a table has for the lobes that use it. */
struct kiln_brushed_means {
    float lost, glass_front, glass_back, glass_coat, trapped; /* the members of struct kiln_bsdf_lobes */
    /* in: fraction of light that the coat transmits; kept: times the fraction that facets do not lose; share: times
     * their Fresnel share (kiln_fresnel_share); on both sides. From these follows the light of the matt layer, for any
     * specular colour. */
    float in_front, kept_front, share_front, in_back, kept_back, share_back;
    KILN_STRUCT kiln_curve face_lost, face_effective; /* struct kiln_interface, mean over the azimuth */
};

struct kiln_brushed_table {
    float corner;
    float first, last; /* layer coordinates of the first and the last layer; equal if there is one layer */
    KILN_STRUCT kiln_brushed_means means;                            /* for layers */
    float at[KILN_BRUSHED_VALUES * KILN_BRUSHED_T * KILN_BRUSHED_U]; /* indexed by t, u, value (fastest) */
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

/* Computes the address of a layer: `layers` tables after the given one. Addresses are in two words. */
KILN_FUNCTION void kiln_brushed_step(KILN_U32 low, KILN_U32 high, KILN_I32 layers, KILN_OUT(KILN_U32) to_low,
                                     KILN_OUT(KILN_U32) to_high)
{
    const KILN_U32 sum = low + KILN_TO_U32(layers) * KILN_BRUSHED_BYTES;
    KILN_AT(to_high) = sum < low ? high + 1u : high;
    KILN_AT(to_low) = sum;
}

/* Converts t to its grid coordinate, 0 to KILN_BRUSHED_T - 1; and back. */
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

/* Lagrange weight of the value at `layer`, 0 to 3, at x, for the cubic polynomial through the values of four layers. */
KILN_FUNCTION float kiln_brushed_weight(KILN_I32 layer, float x)
{
    const float half_ = 0.5f * x * (x - 3.0f);
    if (layer == 0 || layer == 3)
        return KILN_RATIO32(1, 6) * (x - 1.0f) * (x - 2.0f) * (layer == 0 ? 3.0f - x : x);
    return layer == 1 ? half_ * (x - 2.0f) : half_ * (1.0f - x);
}

/* Interpolates bilinearly in the table `next`, from point k; a and b are the fractions towards the next points along t
 * and u. */
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

/* Looks up the value KILN_BRUSHED_... for a unit direction with component `rough` along the rough axis and z along the
 * normal. The table's address is in two words; `part` is the layer coordinate, relative to the first of four. */
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
    const KILN_I32 layers = part == 0.0f ? 1 : 4; /* unknown at compile time, so that the loop is not unrolled */
    float sum = 0.0f;
    for (KILN_I32 layer = 0; layer < layers; layer++)
        sum += (layers == 1 ? 1.0f : kiln_brushed_weight(layer, part)) *
               kiln_brushed_between(address_low, address_high, layer, k, a, b);
    if (layers == 1)
        return sum;
    return float_max(value == KILN_BRUSHED_FRESNEL ? float_min(sum, 1.0f) : sum, 0.0f);
}

#endif
