/* Fresnel reflectance of an interface between two media, in float. Cosines are between a direction and the normal of
 * the surface or microfacet, 0 to 1. `eta` is the relative index: of the medium behind the interface / of the medium
 * that the light is in. */
#ifndef KILN_SHADERS_SHARED_FRESNEL_H
#define KILN_SHADERS_SHARED_FRESNEL_H

#include "shaders/shared/language.h"

#define KILN_COAT_INDEX 1.5f /* KHR_materials_clearcoat */

/* Cosine of the refracted direction (Snell's law); 0 for total reflection. */
KILN_FUNCTION float kiln_refracted_cosine(float cosine, float eta)
{
    return float_sqrt(float_max(0.0f, 1.0f - (1.0f - cosine) * (1.0f + cosine) / (eta * eta)));
}

/* Reflectance of a dielectric, exact, for unpolarised light (Born and Wolf, "Principles of Optics", section 1.5.2); 1
 * where the reflection is total. With eta 1 nothing is reflected at any angle. */
KILN_FUNCTION float kiln_fresnel(float cosine, float eta)
{
    const float t = kiln_refracted_cosine(cosine, eta);
    if (t == 0.0f && eta != 1.0f)
        return 1.0f;
    const float s = (cosine - eta * t) / float_max(cosine + eta * t, KILN_FLOAT_TINY);
    const float p = (eta * cosine - t) / float_max(eta * cosine + t, KILN_FLOAT_TINY);
    return float_min(0.5f * (s * s + p * p), 1.0f);
}

/* Reflectance at normal incidence. */
KILN_FUNCTION float kiln_fresnel_normal(float eta)
{
    const float a = (eta - 1.0f) / (eta + 1.0f);
    return a * a;
}

/* Interpolation factor of the reflectance between normal (0) and grazing incidence (1), for metals: Schlick ("An
 * Inexpensive BRDF Model for Physically-based Rendering", EUROGRAPHICS 1994, equation 15). The base colour of a metal
 * is its reflectance at normal incidence (glTF 2.0, appendix B.2.3). */
KILN_FUNCTION float kiln_schlick_share(float cosine)
{
    const float a = 1.0f - cosine, b = a * a;
    return b * b * a;
}
/* Interpolation factor for dielectrics, from the exact reflectance: with colour and factor of KHR_materials_specular 1
 * the result is the exact reflectance. `normal`: the exact reflectance at normal incidence. */
KILN_FUNCTION float kiln_fresnel_share(float exact, float normal)
{
    return float_max(exact - normal, 0.0f) / (1.0f - normal);
}

/* Reflectance of one channel of a dielectric with KHR_materials_specular of strength `specular`: the exact reflectance,
 * scaled so that at normal incidence it changes from `normal` to normal x color. */
KILN_FUNCTION float kiln_fresnel_scaled(float specular, float exact, float normal, float color)
{
    const float low = float_min(normal * color, 1.0f) * specular;
    return low + (specular - low) * kiln_fresnel_share(exact, normal);
}

/* Cosine-weighted mean of Schlick's reflectance over the hemisphere. */
KILN_FUNCTION float kiln_schlick_mean(float normal) { return (20.0f * normal + 1.0f) * KILN_RATIO32(1, 21); }

/* Index of a medium for red, green and blue (KHR_materials_dispersion), by Cauchy's law with the index at 587.56 nm and
 * the Abbe number, 20 / dispersion. The wavelengths are the dominant ones of sRGB's primaries: 611.4, 549.1 and 464.3
 * nm. */
KILN_FUNCTION KILN_VECTOR kiln_dispersed_index(float index, float dispersion)
{
    const float spread = (index - 1.0f) * dispersion * 0.05f;
    return vec3(float_max(index - 0.11594f * spread, 1.0f), float_max(index + 0.21997f * spread, 1.0f),
                float_max(index + 0.91231f * spread, 1.0f));
}

#endif
