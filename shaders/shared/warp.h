/* From random numbers to rays, in float: fractions of 2^32 to the unit interval, tangents of a normal, weights of
 * directions. */
#ifndef KILN_SHADERS_SHARED_WARP_H
#define KILN_SHADERS_SHARED_WARP_H

#include "shaders/shared/language.h"

/* Returns the centre of the 2^-23 interval that contains a 32-bit fraction. It is exact, and so strictly inside (0, 1)
 * in float (2^-24 would round to 1). */
KILN_FUNCTION float kiln_unit_float(KILN_U32 fraction)
{
    return (KILN_TO_F32(fraction >> 9) + 0.5f) * KILN_RATIO32(1, 8388608);
}

/* Orthonormal tangents of unit n (Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 2017). */
KILN_FUNCTION void kiln_basis(KILN_VECTOR n, KILN_OUT(KILN_VECTOR) t, KILN_OUT(KILN_VECTOR) b)
{
#ifdef KILN_GLSL
    const float side = n.z < 0.0f || (n.z == 0.0f && floatBitsToUint(n.z) != 0u) ? -1.0f : 1.0f; /* -0 counts */
#else
    const float side = copysignf(1.0f, n.z);
#endif
    const float a = -1.0f / (side + n.z), c = n.x * n.y * a;
    KILN_AT(t) = vec3(1.0f + side * n.x * n.x * a, side * c, -side * n.x);
    KILN_AT(b) = vec3(c, side + n.y * n.y * a, -n.y);
}

/* sin(2 pi x) for |x| <= 1/4: odd polynomial, error below 3e-7. */
KILN_FUNCTION float kiln_sine_turn(float x)
{
    const float y = x * x;
    return x * (6.28318525f + y * (-41.3416996f + y * (81.6018372f + y * (-76.5498123f + y * 39.5374527f))));
}

/* Sine and cosine of `turns` whole turns, in 0 .. 1; errors below 3e-7. */
KILN_FUNCTION void kiln_turn(float turns, KILN_OUT(float) sine, KILN_OUT(float) cosine)
{
    const float t = turns - 0.5f, a = float_abs(t); /* half a turn less: sine and cosine change their signs */
    const float s = kiln_sine_turn(float_min(a, 0.5f - a));
    KILN_AT(sine) = t < 0.0f ? s : -s;
    KILN_AT(cosine) = kiln_sine_turn(a - 0.25f);
}

/* Weights of directions that are cosine-distributed about the axis half-way between the geometric normal n and the
 * shading normal s. A direction w has the density (n.w + s.w) / |n + s| over pi: the irradiance about either normal is
 * a mean with weights that stay below 2 wherever both cosines are positive, where sampling about n alone has s.w / n.w
 * without bound.
 *
 * kiln_facet_weight is the weight for irradiance about the geometric normal; 0: the direction lies below the surface.
 * The wedge above the surface but below the axis' horizon is never drawn; the factor 2 / (1 + cos tilt) makes up for
 * its share, so that the weights' mean is 1 and no energy is lost. `above`, `tilt` and `cosine` are the cosines between
 * direction and normal, normal and axis, direction and axis. */
KILN_FUNCTION float kiln_facet_weight(float above, float tilt, float cosine)
{
    return above > 0.0f ? 2.0f / (1.0f + tilt) * above / cosine : 0.0f;
}
/* Weight for irradiance about the shading normal; `shading` is the normal's cosine with the direction. */
KILN_FUNCTION float kiln_shading_weight(float shading, float cosine)
{
    return shading > 0.0f ? shading / cosine : 0.0f;
}

#endif
