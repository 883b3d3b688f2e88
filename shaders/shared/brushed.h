/* What brushed facets lose and reflect of light from a direction, as tables that are made for a material
 * (worker/material/brushed.h); the same in C and GLSL.
 *
 * Facets that are rough along one axis and smooth along the other hardly change the component of a direction along the
 * smooth axis, y: so tables are over y, and over the cosine within the plane across it. The variables are
 *
 *     t = (1 - y^2)^(1/4)    0 along the smooth axis, 1 across it
 *     u = sqrt(|z| / sqrt(1 - y^2))
 *
 * From within the denser medium nothing gets out where y > 1 / index; what is lost bends there, and so t has a knot at
 * that place, `corner`, with more points below it. Between points values are linear in both. */
#ifndef KILN_SHADERS_SHARED_BRUSHED_H
#define KILN_SHADERS_SHARED_BRUSHED_H

#include "shaders/shared/language.h"

#define KILN_BRUSHED_T 33   /* points along t, */
#define KILN_BRUSHED_LOW 22 /* of which this one is at the corner, */
#define KILN_BRUSHED_U 25   /* and along u */

/* What a table has of each direction. */
#define KILN_BRUSHED_WHOLE 0   /* lost, were all reflected */
#define KILN_BRUSHED_FRESNEL 1 /* mean exact Fresnel reflectance, weighted by what facets reflect, from outside */
#define KILN_BRUSHED_THIN 2    /* glass: lost, reflected and refracted light together, from the thinner medium */
#define KILN_BRUSHED_DENSE 3   /* and from the denser one */
#define KILN_BRUSHED_HELD 4    /* kiln_bsdf_held */
#define KILN_BRUSHED_COAT 5    /* kiln_bsdf_coat_factor */
#define KILN_BRUSHED_VALUES 6

struct kiln_brushed_table {
    float corner;
    float at[KILN_BRUSHED_VALUES * KILN_BRUSHED_T * KILN_BRUSHED_U]; /* of t, of u, of the values above */
};

#ifdef KILN_GLSL
KILN_ARRAY(BrushedTables, kiln_brushed_table, 4);
#    define KILN_BRUSHED_THERE (HAS_BRUSHED != 0u)
#    define KILN_BRUSHED_TABLE(low, high) BrushedTables(packUint2x32(uvec2(low, high))).at[0]
#else
#    define KILN_BRUSHED_THERE true
#    define KILN_BRUSHED_TABLE(low, high)                                                                              \
        (*(const struct kiln_brushed_table *)(uintptr_t)((uint64_t)(high) << 32 | (uint64_t)(low)))
#endif

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

/* The table's value KILN_BRUSHED_... of a unit direction; its components are `rough` along the rough axis and z along
 * the normal. The table's address is in two words. */
KILN_FUNCTION float kiln_brushed_at(KILN_U32 address_low, KILN_U32 address_high, float rough, float z, KILN_I32 value)
{
    const float across = float_sqrt(rough * rough + z * z), last = KILN_TO_F32(KILN_BRUSHED_U - 1);
    const float u = last * float_min(float_sqrt(float_abs(z) / float_max(across, KILN_FLOAT_TINY)), 1.0f);
    const float p =
        kiln_brushed_place(float_min(float_sqrt(across), 1.0f), KILN_BRUSHED_TABLE(address_low, address_high).corner);
    const KILN_I32 i = KILN_TO_I32(float_min(p, KILN_TO_F32(KILN_BRUSHED_T - 2)));
    const KILN_I32 j = KILN_TO_I32(float_min(u, last - 1.0f));
    const float a = float_min(p - KILN_TO_F32(i), 1.0f), b = u - KILN_TO_F32(j);
    const KILN_I32 k = (i * KILN_BRUSHED_U + j) * KILN_BRUSHED_VALUES + value, next = k + KILN_BRUSHED_VALUES;
    const KILN_I32 row = KILN_BRUSHED_U * KILN_BRUSHED_VALUES;
    const float here = (1.0f - b) * KILN_BRUSHED_TABLE(address_low, address_high).at[k] +
                       b * KILN_BRUSHED_TABLE(address_low, address_high).at[next];
    const float there = (1.0f - b) * KILN_BRUSHED_TABLE(address_low, address_high).at[k + row] +
                        b * KILN_BRUSHED_TABLE(address_low, address_high).at[next + row];
    return (1.0f - a) * here + a * there;
}

#endif
