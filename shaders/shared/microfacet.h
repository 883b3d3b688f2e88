/* Microfacet models of rough surfaces, in float, about the normal +z. Directions are unit and point away from the
 * surface; o is the given direction, i the sampled one. GGX has roughnesses alpha along x and y, 0.001 to 1. Beckmann
 * with the grooves of Cook and Torrance serves to reproduce older pictures. */
#ifndef KILN_SHADERS_SHARED_MICROFACET_H
#define KILN_SHADERS_SHARED_MICROFACET_H

#include "shaders/shared/warp.h"

/* Unit vector along a; +z for the zero vector. */
KILN_FUNCTION KILN_VECTOR kiln_direction_of(KILN_VECTOR a)
{
    const float length = vec3_length(a);
    return length > 0.0f ? vec3_scale(a, 1.0f / length) : vec3(0.0f, 0.0f, 1.0f);
}
KILN_FUNCTION KILN_VECTOR kiln_reflected(KILN_VECTOR o, KILN_VECTOR h)
{
    return vec3_sub(vec3_scale(h, 2.0f * vec3_dot(o, h)), o);
}
/* Refracted direction. `eta`: refractive index on o's side over that on the other side; `cosine`: of o with h;
 * `behind`: cosine with h on the other side (Walter et al., "Microfacet Models for Refraction through Rough Surfaces",
 * EGSR 2007, equation 40). */
KILN_FUNCTION KILN_VECTOR kiln_refracted(KILN_VECTOR o, KILN_VECTOR h, float eta, float cosine, float behind)
{
    return kiln_direction_of(vec3_sub(vec3_scale(h, eta * cosine - behind), vec3_scale(o, eta)));
}

/* ---- GGX ---- */

/* Density of facets, per steradian and unit of the surface's area (Trowbridge and Reitz; Heitz, "Understanding the
 * Masking-Shadowing Function", JCGT 2014, equation 85). */
KILN_FUNCTION float kiln_ggx(KILN_VECTOR h, float alpha_x, float alpha_y)
{
    const float x = h.x / alpha_x, y = h.y / alpha_y, v = x * x + y * y + h.z * h.z;
    return KILN_INVERSE_PI / (alpha_x * alpha_y * v * v);
}

/* Stretched length |(alpha_x x, alpha_y y, z)|, from which with |z| Smith's masking follows: Lambda is (length / |z| -
 * 1) / 2 (Heitz 2014, equation 86). */
KILN_FUNCTION float kiln_ggx_stretch(KILN_VECTOR o, float alpha_x, float alpha_y)
{
    const float x = alpha_x * o.x, y = alpha_y * o.y;
    return float_sqrt(x * x + y * y + o.z * o.z);
}

/* Height-correlated masking and shadowing over the product of both cosines: G2 / (o.z i.z) with G2 = 1 / (1 + Lambda(o)
 * + Lambda(i)) (Heitz 2014, equation 99). Arguments: absolute cosines and stretched lengths. */
KILN_FUNCTION float kiln_ggx_visible(float o, float i, float stretch_o, float stretch_i)
{
    return 2.0f / float_max(stretch_o * i + stretch_i * o, KILN_FLOAT_TINY);
}

/* Samples a facet normal visible from o, for u and v in (0, 1), o.z > 0 (Heitz, "Sampling the GGX Distribution of
 * Visible Normals", JCGT 2018, by the caps of Dupuy and Benyoub, "Sampling Visible GGX Normals with Spherical Caps",
 * HPG 2023, listing 3). */
KILN_FUNCTION KILN_VECTOR kiln_ggx_sample(KILN_VECTOR o, float alpha_x, float alpha_y, float u, float v)
{
    const KILN_VECTOR s = kiln_direction_of(vec3(alpha_x * o.x, alpha_y * o.y, o.z));
    const float z = (1.0f - v) * (1.0f + s.z) - s.z;
    const float r = float_sqrt(float_max(0.0f, (1.0f - z) * (1.0f + z)));
    float sine, cosine;
    kiln_turn(u, KILN_TO(sine), KILN_TO(cosine));
    return kiln_direction_of(vec3(alpha_x * (r * cosine + s.x), alpha_y * (r * sine + s.y), float_max(z + s.z, 0.0f)));
}
/* Density of kiln_ggx_sample over |o.h|, per steradian: the facet density `facets` times 2 / (o.z + stretch), which is
 * G1(o) / o.z. */
KILN_FUNCTION float kiln_ggx_seen(float facets, float o, float stretch_o) { return 2.0f * facets / (o + stretch_o); }

/* ---- Beckmann, with the grooves of Cook and Torrance ---- */

/* Density of facets (Cook and Torrance, "A Reflectance Model for Computer Graphics", ACM TOG 1982, normalised as in
 * Walter et al. 2007, equation 25). */
KILN_FUNCTION float kiln_beckmann(KILN_VECTOR h, float alpha)
{
    const float c = h.z * h.z, a = alpha * alpha;
    if (c < KILN_FLOAT_TINY)
        return 0.0f;
    return float_exp(-(1.0f - c) / (c * a)) * KILN_INVERSE_PI / (a * c * c);
}
/* Samples a facet normal with density facets * h.z (Walter et al. 2007, equations 28 and 29). */
KILN_FUNCTION KILN_VECTOR kiln_beckmann_sample(float alpha, float u, float v)
{
    const float tangent = -alpha * alpha * float_log(v), z = 1.0f / float_sqrt(1.0f + tangent);
    const float r = float_sqrt(float_max(0.0f, (1.0f - z) * (1.0f + z)));
    float sine, cosine;
    kiln_turn(u, KILN_TO(sine), KILN_TO(cosine));
    return vec3(r * cosine, r * sine, z);
}
/* Masking and shadowing by grooves (Cook and Torrance 1982, page 12). */
KILN_FUNCTION float kiln_grooves(KILN_VECTOR o, KILN_VECTOR i, KILN_VECTOR h)
{
    const float twice = 2.0f * h.z / float_max(vec3_dot(o, h), KILN_FLOAT_TINY);
    return float_min(1.0f, twice * float_min(o.z, i.z));
}

#endif
