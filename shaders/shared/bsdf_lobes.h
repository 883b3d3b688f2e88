/* Material at a point, and the quantities of its BSDF that do not depend on directions; part of shaders/shared/bsdf.h.
 *
 * The layers are those of glTF 2.0 (appendix B) with KHR_materials_specular, _ior, _transmission, _volume, _clearcoat,
 * _anisotropy and _dispersion. A clear coat (a dielectric of index 1.5, on the front only, or on both sides of a thin
 * wall) lies over a base. The base is a mixture of three, by area:
 *
 *   metal   GGX with Schlick's reflectance; the base colour is the reflectance at normal incidence
 *   glass   GGX by visible normals that reflects and refracts, exact Fresnel; transmitted light has the base colour.
 *           A thin wall transmits without refraction: the reflected lobe, mirrored to the other side
 *   matt    the reflection of a dielectric over a diffuse surface of the base colour
 *
 * Energy that single scattering of facets loses is compensated. Metals: as in Kulla and Conty (2017). Glass: on both
 * sides, as if multiple scattering forgets the origin of light. Matt: by the diffuse surface below, whose value is (1 -
 * E(o)) (1 - E(i)) / (pi (1 - mean E)) times its colour, with E the albedo of all above it. */
#ifndef KILN_SHADERS_SHARED_BSDF_LOBES_H
#define KILN_SHADERS_SHARED_BSDF_LOBES_H

#include "shaders/shared/brushed.h"
#include "shaders/shared/color.h"
#include "shaders/shared/microfacet.h"
#include "shaders/shared/microfacet_albedo.h"

/* `model` */
#define KILN_BSDF_LAYERS 0u /* as above */
/* base_color / pi + specular_color (n + 2) / (2 pi) cos^n of the angle to the mirror direction */
#define KILN_BSDF_PHONG 1u
/* base_color / pi + Beckmann facets with Schlick's reflectance; specular_color: reflectance at normal incidence */
#define KILN_BSDF_COOK_TORRANCE 2u

/* Kinds of lobes that some material of a scene may have. A kernel has code only for its scene's kinds, by the
 * specialisation constant LOBE_KINDS: that code is long, and drivers take seconds to compile it. C always has all. */
#define KILN_BSDF_MAY_COAT 1u
#define KILN_BSDF_MAY_GLASS 2u
#define KILN_BSDF_MAY_ROUGH_GLASS 4u
#define KILN_BSDF_MAY_MIRROR 8u  /* the base is one, or smooth glass */
#define KILN_BSDF_MAY_ACROSS 16u /* different roughnesses along the tangent and across it */
#define KILN_BSDF_MAY_OLDER 32u  /* models other than KILN_BSDF_LAYERS */
#define KILN_BSDF_MAY_DISPERSE 64u
#ifdef KILN_GLSL
#    define KILN_BSDF_MAY(kinds) ((LOBE_KINDS & (kinds)) != 0u)
#else
#    define KILN_BSDF_MAY(kinds) true
#endif

/* A material at a point. Colours are linear, 0 to 1. */
struct kiln_bsdf {
    KILN_VECTOR base_color;
    KILN_VECTOR specular_color; /* KHR_materials_specular; of the other models the reflectance of the specular part */
    KILN_VECTOR eta;            /* index of refraction behind the face / before it, for red, green and blue */
    float metallic, transmission, specular; /* 0 to 1; `specular` is 1 by default */
    float alpha_x, alpha_y;                 /* roughness squared (kiln_bsdf_alphas); Beckmann's is alpha_x */
    float coat, coat_alpha;                 /* KHR_materials_clearcoat; its roughness squared */
    float exponent;                         /* Phong's n, >= 0 */
    KILN_U32 thin_wall;                     /* 1: transmission through a thin wall; 0: the face bounds a volume */
    KILN_U32 model;
};

/* Precomputed quantities at a point, valid for all directions; for use within bsdf.h. */
struct kiln_bsdf_lobes {
    KILN_STRUCT kiln_bsdf p;
    float metal, glass, matt; /* shares of the base; their sum is 1 */
    float alpha_x, alpha_y;
    KILN_U32 base_is_mirror, coat_is_mirror, disperses; /* 0 or 1: buffers hold no bool */
    KILN_U32 holds;                                     /* 0 or 1: `trapped` is known */
    KILN_U32 brushed_low, brushed_high;                 /* address of a struct kiln_brushed_table; 0: there is none */
    float brushed_part;                                 /* fraction of the way to the next layer */
    KILN_STRUCT kiln_interface face;
    KILN_STRUCT kiln_boundary boundary; /* set for a rough boundary of glass */
    KILN_STRUCT kiln_coat coat;
    KILN_VECTOR metal_spread; /* colour of multiple scattering by metals */
    float lost_mean;          /* cosine-weighted mean over the hemisphere of the loss by facets; likewise below: */
    float glass_lost_front, glass_lost_back, glass_lost_coat; /* loss by glass on each side; front times the coat's T */
    float under_front, under_back;  /* fraction that reaches the diffuse surface; 1 if there is none */
    KILN_STRUCT kiln_curve trapped; /* kiln_bsdf_trapped, in Chebyshev polynomials of 2 sqrt(mu) - 1 */
    float trapped_mean;             /* mean of kiln_bsdf_trapped; 0 if unknown */
};

/* Computes alphas along the tangent and across it, from glTF's roughness and anisotropy strength, 0 to 1
 * (KHR_materials_anisotropy). The caller rotates the tangent. */
KILN_FUNCTION void kiln_bsdf_alphas(float roughness, float strength, KILN_OUT(float) alpha_x, KILN_OUT(float) alpha_y)
{
    const float alpha = roughness * roughness;
    KILN_AT(alpha_x) = alpha + (1.0f - alpha) * strength * strength;
    KILN_AT(alpha_y) = alpha;
}

/* Alpha of facets whose lobe is about as wide as a Phong lobe of this exponent (Walter et al. 2007, section 5.2). */
KILN_FUNCTION float kiln_bsdf_phong_alpha(float exponent) { return float_sqrt(2.0f / (exponent + 2.0f)); }
/* Exponent that represents a mirror over a diffuse surface in Phong's model: a lobe of a quarter of a degree. */
#define KILN_BSDF_PHONG_MIRROR 1.0e5f

/* Share of the base that is diffuse. */
KILN_FUNCTION float kiln_bsdf_matt(KILN_STRUCT kiln_bsdf p)
{
    return p.model == KILN_BSDF_LAYERS ? (1.0f - p.metallic) * (1.0f - p.transmission) : 1.0f;
}

KILN_FUNCTION float kiln_bsdf_luminance(KILN_VECTOR rgb)
{
    return vec3_dot(
        rgb, vec3(KILN_RED_WEIGHT(KILN_RATIO32), KILN_GREEN_WEIGHT(KILN_RATIO32), KILN_BLUE_WEIGHT(KILN_RATIO32)));
}
KILN_FUNCTION KILN_VECTOR kiln_bsdf_gray(float a) { return vec3(a, a, a); }

/* ---- the reflectance of a dielectric with KHR_materials_specular ---- */

struct kiln_bsdf_fresnel {
    KILN_VECTOR reflected, through; /* through: 1 - the largest channel, so that it is not coloured */
};
/* Reflectance of one channel of a dielectric with KHR_materials_specular. `exact`: the Fresnel reflectance. `normal`:
 * the Fresnel reflectance at normal incidence. The result goes from normal x color (at most 1) at normal incidence to 1
 * at grazing incidence, both times the specular strength. */
KILN_FUNCTION float kiln_bsdf_scaled(KILN_STRUCT kiln_bsdf p, float exact, float normal, float color)
{
    return kiln_fresnel_scaled(p.specular, exact, normal, color);
}
KILN_FUNCTION float kiln_bsdf_largest(KILN_VECTOR rgb) { return float_max(rgb.x, float_max(rgb.y, rgb.z)); }

/* Computes reflectance and transmittance at a facet; eta: relative index of the medium on the other side. */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_fresnel kiln_bsdf_fresnel_at(KILN_STRUCT kiln_bsdf p, float cosine, KILN_VECTOR eta)
{
    KILN_STRUCT kiln_bsdf_fresnel f;
    const KILN_VECTOR color = p.specular_color;
    const float most = kiln_bsdf_largest(color);
    const float y = kiln_fresnel(cosine, eta.y);
    const bool gray = !KILN_BSDF_MAY(KILN_BSDF_MAY_DISPERSE);
    const float x = gray || eta.x == eta.y ? y : kiln_fresnel(cosine, eta.x);
    const float z = gray || eta.z == eta.y ? y : kiln_fresnel(cosine, eta.z);
    const float nx = kiln_fresnel_normal(eta.x), ny = kiln_fresnel_normal(eta.y), nz = kiln_fresnel_normal(eta.z);
    /* total reflection ignores the specular colour */
    f.reflected = vec3(x < 1.0f ? kiln_bsdf_scaled(p, x, nx, color.x) : 1.0f,
                       y < 1.0f ? kiln_bsdf_scaled(p, y, ny, color.y) : 1.0f,
                       z < 1.0f ? kiln_bsdf_scaled(p, z, nz, color.z) : 1.0f);
    f.through = vec3(x < 1.0f ? 1.0f - kiln_bsdf_scaled(p, x, nx, most) : 0.0f,
                     y < 1.0f ? 1.0f - kiln_bsdf_scaled(p, y, ny, most) : 0.0f,
                     z < 1.0f ? 1.0f - kiln_bsdf_scaled(p, z, nz, most) : 0.0f);
    return f;
}

/* ---- coat, losses and albedos ---- */

/* Relative index of glass: of the other side / of this side. */
KILN_FUNCTION KILN_VECTOR kiln_bsdf_eta(KILN_STRUCT kiln_bsdf p, bool front)
{
    if (front || p.thin_wall != 0u)
        return p.eta;
    return vec3(1.0f / p.eta.x, 1.0f / p.eta.y, 1.0f / p.eta.z);
}

/* Number of directions in a quarter turn, for means over the azimuth of anisotropic facets. */
#define KILN_TURN_POINTS 4

/* Tells whether a side has the coat. The next function gives the coat's albedo on that side. */
KILN_FUNCTION bool kiln_bsdf_coated(KILN_STRUCT kiln_bsdf_lobes l, bool front)
{
    return KILN_BSDF_MAY(KILN_BSDF_MAY_COAT) && l.coat.strength > 0.0f && (front || l.p.thin_wall != 0u);
}
KILN_FUNCTION float kiln_bsdf_coat_albedo(KILN_STRUCT kiln_bsdf_lobes l, bool front, float mu)
{
    return kiln_bsdf_coated(l, front) ? kiln_coat_albedo(l.coat, mu) : 0.0f;
}
/* Tells whether the material has a table for its brushed (anisotropic) facets (shaders/shared/brushed.h). Then `face`
 * has the means over the azimuth. */
KILN_FUNCTION bool kiln_bsdf_has_table(KILN_STRUCT kiln_bsdf_lobes l)
{
    return KILN_BRUSHED_THERE && (l.brushed_low | l.brushed_high) != 0u;
}
KILN_FUNCTION float kiln_bsdf_from_table(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR w, KILN_I32 value)
{
    return kiln_brushed_at(l.brushed_low, l.brushed_high, l.brushed_part, l.alpha_x < l.alpha_y ? w.y : w.x, w.z,
                           value);
}

/* Factor of the coat on the base's scattering, for a direction with either sign of z. */
KILN_FUNCTION float kiln_bsdf_coat_factor(KILN_STRUCT kiln_bsdf_lobes l, bool front, KILN_VECTOR w)
{
    if (!kiln_bsdf_coated(l, front))
        return 1.0f;
    if (kiln_bsdf_has_table(l))
        return kiln_bsdf_from_table(l, w, KILN_BRUSHED_COAT);
    return kiln_coat_factor(l.coat, float_abs(w.z));
}

/* Fraction of light from a direction that perfectly reflecting facets lose; and, in the next function, its mean over
 * the azimuth at one cosine. */
KILN_FUNCTION float kiln_bsdf_facets_lost(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR w)
{
    if (!KILN_BSDF_MAY(KILN_BSDF_MAY_ACROSS) || l.alpha_x == l.alpha_y || l.base_is_mirror != 0u)
        return kiln_interface_lost(l.face, float_abs(w.z));
    if (kiln_bsdf_has_table(l))
        return kiln_bsdf_from_table(l, w, KILN_BRUSHED_WHOLE);
    return kiln_across_lost(w, l.alpha_x, l.alpha_y);
}
KILN_FUNCTION float kiln_bsdf_facets_lost_about(KILN_STRUCT kiln_bsdf_lobes l, float mu)
{
    if (!KILN_BSDF_MAY(KILN_BSDF_MAY_ACROSS) || l.alpha_x == l.alpha_y || l.base_is_mirror != 0u ||
        l.metal + l.glass == 0.0f)
        return kiln_interface_lost(l.face, mu);
    const float r = float_sqrt((1.0f - mu) * (1.0f + mu));
    float sum = 0.0f;
    for (int k = 0; k < KILN_TURN_POINTS; k++) {
        float sine, cosine;
        kiln_turn((KILN_TO_F32(k) + 0.5f) / KILN_TO_F32(4 * KILN_TURN_POINTS), KILN_TO(sine), KILN_TO(cosine));
        sum += kiln_across_lost(vec3(r * cosine, r * sine, mu), l.alpha_x, l.alpha_y);
    }
    return sum / KILN_TO_F32(KILN_TURN_POINTS);
}

/* Reflectance of the matt layer's interface, its largest channel. `lost`: the fraction that facets lose; `exact`: exact
 * Fresnel reflectance of the rest. */
KILN_FUNCTION float kiln_bsdf_matt_share(KILN_STRUCT kiln_bsdf_lobes l, float lost, float exact)
{
    return (1.0f - lost) *
           kiln_bsdf_scaled(l.p, exact, kiln_fresnel_normal(l.face.index), kiln_bsdf_largest(l.p.specular_color));
}
/* Reflectance of the matt layer's interface at a cosine, as the mean over azimuths; and, below, for a direction. */
KILN_FUNCTION float kiln_bsdf_matt_about(KILN_STRUCT kiln_bsdf_lobes l, float mu)
{
    const float exact = kiln_interface_fresnel(l.face, mu);
    return kiln_bsdf_matt_share(l, kiln_interface_lost(l.face, mu), exact);
}
KILN_FUNCTION float kiln_bsdf_matt_albedo(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR w)
{
    if (kiln_bsdf_has_table(l))
        return kiln_bsdf_matt_share(l, kiln_bsdf_from_table(l, w, KILN_BRUSHED_WHOLE),
                                    kiln_bsdf_from_table(l, w, KILN_BRUSHED_FRESNEL));
    return kiln_bsdf_matt_about(l, float_abs(w.z));
}

/* Returns the fraction of light from a direction that glass loses. `front`: its side; `facets`: kiln_bsdf_facets_lost
 * of the direction. */
KILN_FUNCTION float kiln_bsdf_glass_lost(KILN_STRUCT kiln_bsdf_lobes l, bool front, KILN_VECTOR w, float facets)
{
    if (!KILN_BSDF_MAY(KILN_BSDF_MAY_ROUGH_GLASS) || l.base_is_mirror != 0u)
        return 0.0f;
    if (l.p.thin_wall != 0u)
        return facets;
    const bool dense = front == (l.p.eta.y < 1.0f);
    if (kiln_bsdf_has_table(l))
        return dense ? kiln_bsdf_from_table(l, w, KILN_BRUSHED_DENSE) : kiln_bsdf_from_table(l, w, KILN_BRUSHED_THIN);
    return kiln_boundary_lost(l.boundary, float_abs(w.z), dense);
}

/* ---- light from behind a coat over rough glass ----
 *
 * The coat reflects back a part of the light that the facets of the glass transmit. Two terms model this light.
 *
 * The first term goes into the facets' mirror directions (kiln_bsdf_mirrored). The coat has one reflectance for the
 * light that a facet transmits from o, and another for that from i. The term has their geometric mean, so that it is
 * reciprocal. This approximation gets worse with roughness. So the term is scaled down as roughness grows, and never
 * exceeds the light sent back.
 *
 * The second term is the rest: a diffuse lobe trapped(o) trapped(i) / (pi mean trapped), with kiln_bsdf_trapped. Kulla
 * and Conty ("Revisiting Physically Based Shading at Imageworks", 2017) use such a lobe for the facets' loss. `trapped`
 * depends on the cosine, the index and both roughnesses. It is computed once for a material, by summing over its
 * facets: 377 facets at each of 9 cosines. That is too slow at each hit of a textured material, which has a table
 * instead. */

KILN_FUNCTION bool kiln_bsdf_holds(KILN_STRUCT kiln_bsdf_lobes l)
{
    return KILN_BSDF_MAY(KILN_BSDF_MAY_COAT) && l.coat.strength > 0.0f && l.glass > 0.0f && l.p.thin_wall == 0u;
}
KILN_FUNCTION float kiln_bsdf_mirrored_share(KILN_STRUCT kiln_bsdf_lobes l)
{
    return l.holds != 0u ? 1.0f / (1.0f + 2.4f * l.face.alpha) : 1.0f;
}

/* Returns the fraction that the coat reflects into the mirror direction, for light from behind transmitted by a facet h
 * at `cosine` to the facet. o, i and h are cosines to the surface. */
KILN_FUNCTION float kiln_bsdf_mirrored(KILN_STRUCT kiln_bsdf_lobes l, float o, float i, float h, float cosine)
{
    const float eta = kiln_bsdf_eta(l.p, false).y;
    const float bend = h * (kiln_refracted_cosine(cosine, eta) - cosine / eta);
    const float zo = o / eta + bend, zi = i / eta + bend; /* not above 0: no light gets out that way */
    const float of_o = zo > 0.0f ? kiln_coat_albedo(l.coat, zo) : 0.0f;
    const float of_i = zi > 0.0f ? kiln_coat_albedo(l.coat, zi) : 0.0f;
    return kiln_bsdf_mirrored_share(l) * float_sqrt(of_o * of_i);
}

/* Returns the fraction of light from behind that the facet h sends on, to both sides: mirrored, reflected back by the
 * coat, or refracted. o: direction that the light comes from, with z > 0 behind. The facet is one that kiln_ggx_sample
 * draws from o. */
KILN_FUNCTION float kiln_bsdf_sent_behind(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR o, KILN_VECTOR h)
{
    const float eta = kiln_bsdf_eta(l.p, false).y, cosine = vec3_dot(o, h);
    const float outside = kiln_refracted_cosine(cosine, eta), back = kiln_fresnel(cosine, eta);
    const float own = kiln_ggx_stretch(o, l.alpha_x, l.alpha_y) / o.z;
    KILN_VECTOR i = kiln_reflected(o, h);
    float sent = 0.0f;
    if (i.z > 0.0f) {
        const float seen = (1.0f + own) / (own + kiln_ggx_stretch(i, l.alpha_x, l.alpha_y) / i.z);
        sent += seen * (back + (1.0f - back) * kiln_bsdf_mirrored(l, o.z, i.z, h.z, cosine));
    }
    if (back < 1.0f) {
        i = kiln_refracted(o, h, 1.0f / eta, cosine, outside);
        if (i.z < 0.0f) {
            const float seen = (1.0f + own) / (own - kiln_ggx_stretch(i, l.alpha_x, l.alpha_y) / i.z);
            sent += seen * (1.0f - back) * (1.0f - kiln_coat_albedo(l.coat, -i.z));
        }
    }
    return sent;
}

#define KILN_TRAPPED_POINTS 9
#define KILN_TRAPPED_FACETS 377
KILN_FUNCTION KILN_STRUCT kiln_curve kiln_bsdf_trapped_curve(KILN_STRUCT kiln_bsdf_lobes l)
{
    KILN_STRUCT kiln_curve s;
    for (int j = 0; j < KILN_TRAPPED_POINTS; j++)
        s.c[j] = 0.0f;
    for (int k = 0; k < KILN_TRAPPED_POINTS; k++) {
        float sine, x, sent = 0.0f;
        kiln_turn((KILN_TO_F32(k) + 0.5f) / KILN_TO_F32(2 * KILN_TRAPPED_POINTS), KILN_TO(sine), KILN_TO(x));
        const float root = 0.5f * (1.0f + x), mu = root * root;
        const KILN_VECTOR o = vec3(float_sqrt((1.0f - mu) * (1.0f + mu)), 0.0f, mu);
        for (int j = 0; j < KILN_TRAPPED_FACETS; j++) { /* on one side of the plane of o; the other is symmetric */
            const float u = KILN_TO_F32(j * 233 % KILN_TRAPPED_FACETS) / KILN_TO_F32(2 * KILN_TRAPPED_FACETS);
            const float v = (KILN_TO_F32(j) + 0.5f) / KILN_TO_F32(KILN_TRAPPED_FACETS);
            sent += kiln_bsdf_sent_behind(l, o, kiln_ggx_sample(o, l.alpha_x, l.alpha_y, u, v));
        }
        sent /= KILN_TO_F32(KILN_TRAPPED_FACETS);
        const float missing = 1.0f - sent - kiln_boundary_lost(l.boundary, mu, l.p.eta.y >= 1.0f);
        /* reduced a little, so that a furnace is hardly ever too bright; for nearly smooth facets the missing part is
         * tiny and its peak too narrow for the polynomials */
        const float trapped = (missing - 0.0038f) * l.face.alpha / (l.face.alpha + 0.005f);
        float before = x, now = 1.0f; /* Chebyshev's polynomials at x */
        for (int j = 0; j < KILN_TRAPPED_POINTS; j++) {
            s.c[j] += trapped * now * (j == 0 ? 1.0f : 2.0f) / KILN_TO_F32(KILN_TRAPPED_POINTS);
            const float next = 2.0f * x * now - before;
            before = now;
            now = next;
        }
    }
    return s;
}

/* Returns the fraction of light from behind that the coat sends back diffusely. */
KILN_FUNCTION float kiln_bsdf_trapped(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR w)
{
    if (kiln_bsdf_has_table(l))
        return kiln_bsdf_from_table(l, w, KILN_BRUSHED_TRAPPED);
    const float x = 2.0f * float_sqrt(float_abs(w.z)) - 1.0f;
    float a = 0.0f, b = 0.0f;
    for (int j = KILN_TRAPPED_POINTS - 1; j > 0; j--) { /* Clenshaw's recurrence */
        const float next = 2.0f * x * a - b + l.trapped.c[j];
        b = a;
        a = next;
    }
    return float_max(x * a - b + l.trapped.c[0], 0.0f);
}

/* Table of the curve `trapped` over roughness, for a material with a roughness texture. `bare` is for coat strength 0,
 * `coated` for 1, at equal steps of the roughness and, if that has a texture too, of the coat's roughness. It is
 * interpolated linearly in the strength and in both roughnesses. */
#define KILN_BSDF_TRAPPED_LAYERS 17
#define KILN_BSDF_TRAPPED_COATS 9
struct kiln_bsdf_trapped_table {
    float first, last;           /* steps of the first and the last roughness, 0 to KILN_BSDF_TRAPPED_LAYERS - 1 */
    float coat_first, coat_last; /* steps of the coat's roughness, 0 to KILN_BSDF_TRAPPED_COATS - 1; equal: one only */
    KILN_STRUCT kiln_curve bare[KILN_BSDF_TRAPPED_LAYERS];
    KILN_STRUCT kiln_curve
        coated[KILN_BSDF_TRAPPED_COATS * KILN_BSDF_TRAPPED_LAYERS]; /* by the coat's roughness, then roughness */
};
#ifdef KILN_GLSL
KILN_ARRAY(BsdfTrappedTables, kiln_bsdf_trapped_table, 4);
#    define KILN_BSDF_TRAPPED_THERE (HAS_TRAPPED != 0u)
#    define KILN_BSDF_TRAPPED_TABLE(low, high) BsdfTrappedTables(packUint2x32(uvec2(low, high))).at[0]
#else
#    define KILN_BSDF_TRAPPED_THERE true
#    define KILN_BSDF_TRAPPED_TABLE(low, high)                                                                         \
        (*(const struct kiln_bsdf_trapped_table *)(uintptr_t)((uint64_t)(high) << 32 | (uint64_t)(low)))
#endif

/* ---- the diffuse surface, for code that stores its radiosity ----
 *
 * Irradiance from a direction is weighted by kiln_diffuse_in of the direction. Multiplied by the reflectance
 * kiln_diffuse_color it becomes radiosity B. The radiance leaving towards a direction is B / pi times kiln_diffuse_out.
 * Directions behind the face have z < 0, and cosines are negative there. Under brushed facets both functions depend on
 * the azimuth. If the azimuth of incoming light is unknown, kiln_diffuse_in_about gives the mean, which is exact for
 * light that is uniform over azimuths. */
KILN_FUNCTION KILN_VECTOR kiln_diffuse_color(KILN_STRUCT kiln_bsdf_lobes l)
{
    return vec3_scale(l.p.base_color, l.matt);
}
KILN_FUNCTION float kiln_diffuse_in(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR w)
{
    if (l.p.model != KILN_BSDF_LAYERS)
        return 1.0f;
    return (1.0f - kiln_bsdf_coat_albedo(l, w.z > 0.0f, float_abs(w.z))) * (1.0f - kiln_bsdf_matt_albedo(l, w));
}
KILN_FUNCTION float kiln_diffuse_in_about(KILN_STRUCT kiln_bsdf_lobes l, float cosine)
{
    const float mu = float_abs(cosine);
    if (l.p.model != KILN_BSDF_LAYERS)
        return 1.0f;
    return (1.0f - kiln_bsdf_coat_albedo(l, cosine > 0.0f, mu)) * (1.0f - kiln_bsdf_matt_about(l, mu));
}
KILN_FUNCTION float kiln_diffuse_out(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR w)
{
    return kiln_diffuse_in(l, w) / (w.z > 0.0f ? l.under_front : l.under_back);
}

/* ---- preparing ---- */

/* Fills in `trapped_mean`. */
KILN_FUNCTION void kiln_bsdf_mean_trapped(KILN_INOUT(KILN_STRUCT kiln_bsdf_lobes) l)
{
    for (int k = 0; k < KILN_MEAN_POINTS; k++)
        KILN_AT(l).trapped_mean +=
            KILN_MEAN_WEIGHTS[k] * kiln_bsdf_trapped(KILN_AT(l), vec3(0.0f, 0.0f, KILN_MEAN_COSINES[k]));
}

/* Fills in `holds`, `trapped` and `trapped_mean`; all else in the lobes must be prepared. */
KILN_FUNCTION void kiln_bsdf_find_trapped(KILN_INOUT(KILN_STRUCT kiln_bsdf_lobes) l)
{
    KILN_AT(l).holds = kiln_bsdf_holds(KILN_AT(l)) && KILN_AT(l).base_is_mirror == 0u ? 1u : 0u;
    if (KILN_AT(l).holds == 0u)
        return;
    KILN_AT(l).trapped = kiln_bsdf_trapped_curve(KILN_AT(l));
    kiln_bsdf_mean_trapped(l);
}

KILN_FUNCTION void kiln_bsdf_means(KILN_INOUT(KILN_STRUCT kiln_bsdf_lobes) l)
{
    float lost = 0.0f, front = 0.0f, back = 0.0f, coat = 0.0f, under_front = 0.0f, under_back = 0.0f;
    const bool matt = KILN_AT(l).matt > 0.0f;
    const bool two = KILN_AT(l).coat.strength > 0.0f && KILN_AT(l).p.thin_wall == 0u; /* only the front has the coat */
    for (int k = 0; k < KILN_MEAN_POINTS; k++) {
        const float mu = KILN_MEAN_COSINES[k], w = KILN_MEAN_WEIGHTS[k];
        const float facets = kiln_bsdf_facets_lost_about(KILN_AT(l), mu);
        const KILN_VECTOR any = vec3(0.0f, 0.0f, mu);
        lost += w * facets;
        if (matt)
            under_front += w * kiln_diffuse_in_about(KILN_AT(l), mu);
        if (matt && two)
            under_back += w * kiln_diffuse_in_about(KILN_AT(l), -mu);
        if (KILN_AT(l).glass > 0.0f) {
            const float there = w * kiln_bsdf_glass_lost(KILN_AT(l), true, any, facets);
            front += there;
            back += w * kiln_bsdf_glass_lost(KILN_AT(l), false, any, facets);
            coat += there * (1.0f - kiln_bsdf_coat_albedo(KILN_AT(l), true, mu)); /* for a boundary */
        }
    }
    KILN_AT(l).lost_mean = lost;
    KILN_AT(l).glass_lost_front = front;
    KILN_AT(l).glass_lost_back = back;
    KILN_AT(l).glass_lost_coat = coat;
    KILN_AT(l).under_front = matt ? float_max(under_front, KILN_FLOAT_TINY) : 1.0f;
    KILN_AT(l).under_back = two && matt ? float_max(under_back, KILN_FLOAT_TINY) : KILN_AT(l).under_front;
}

/* Reflectance of multiply scattered light, from the mean reflectance of a facet (Kulla and Conty 2017). */
KILN_FUNCTION float kiln_bsdf_spread(float facet, float lost_mean)
{
    return facet * facet * (1.0f - lost_mean) / (1.0f - facet * lost_mean);
}

/* Sets another base colour in prepared lobes. Only metal_spread depends on it. */
KILN_FUNCTION void kiln_bsdf_dye(KILN_INOUT(KILN_STRUCT kiln_bsdf_lobes) l, KILN_VECTOR color)
{
    const float lost = KILN_AT(l).lost_mean;
    KILN_AT(l).p.base_color = color;
    KILN_AT(l).metal_spread =
        vec3(kiln_bsdf_spread(kiln_schlick_mean(color.x), lost), kiln_bsdf_spread(kiln_schlick_mean(color.y), lost),
             kiln_bsdf_spread(kiln_schlick_mean(color.z), lost));
}

/* Begins lobes: fills in all but the means, the quantities from tables, and metal_spread. */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_lobes kiln_bsdf_begin(KILN_STRUCT kiln_bsdf p)
{
    KILN_STRUCT kiln_bsdf_lobes l;
    const float index = float_max(p.eta.y, 1.0f / p.eta.y);
    const bool layers = p.model == KILN_BSDF_LAYERS;
    l.p = p;
    l.metal = layers ? p.metallic : 0.0f;
    l.glass = layers ? (1.0f - p.metallic) * p.transmission : 0.0f;
    l.matt = kiln_bsdf_matt(p);
    /* glass with an index near 1 is hardly visible even if rough; so reduce its alpha, as facets do not mask others */
    const float seen = l.glass > 0.0f && p.thin_wall == 0u ? float_min((index - 1.0f) * 20.0f, 1.0f) : 1.0f;
    l.alpha_x = float_min(p.alpha_x, 1.0f) * seen;
    l.alpha_y = float_min(p.alpha_y, 1.0f) * seen;
    l.base_is_mirror = float_max(l.alpha_x, l.alpha_y) < KILN_MIRROR_ALPHA ? 1u : 0u;
    l.alpha_x = float_max(l.alpha_x, KILN_MIRROR_ALPHA);
    l.alpha_y = float_max(l.alpha_y, KILN_MIRROR_ALPHA);
    l.coat_is_mirror = p.coat_alpha < KILN_MIRROR_ALPHA ? 1u : 0u;
    l.disperses = p.eta.x != p.eta.y || p.eta.z != p.eta.y ? 1u : 0u;
    const float alpha =
        l.base_is_mirror != 0u ? 0.0f : float_sqrt(0.5f * (l.alpha_x * l.alpha_x + l.alpha_y * l.alpha_y));
    l.face = kiln_interface_of(alpha, index);
    l.boundary = kiln_boundary_of(alpha, index);
    const float partial = p.thin_wall != 0u ? l.matt : l.matt + l.glass;
    l.coat = kiln_coat_of(layers ? p.coat : 0.0f, l.coat_is_mirror != 0u ? 0.0f : float_min(p.coat_alpha, 1.0f), alpha,
                          partial);
    l.holds = 0u;
    l.brushed_low = 0u;
    l.brushed_high = 0u;
    l.brushed_part = 0.0f;
    for (int k = 0; k < KILN_TRAPPED_POINTS; k++)
        l.trapped.c[k] = 0.0f;
    l.trapped_mean = 0.0f;
    return l;
}

/* ---- lobes from the tables of a textured material ---- */

struct kiln_bsdf_tables {
    KILN_U32 brushed_low, brushed_high; /* address of the first layer of brushed facets; 0: there is none */
    KILN_U32 trapped_low, trapped_high; /* of a struct kiln_bsdf_trapped_table */
};

/* Fraction of all light that reaches the matt layer. `let_in`: fraction that the coat transmits; `kept`: times what
 * facets do not lose; `share`: times their Fresnel share (struct kiln_brushed_means). */
KILN_FUNCTION float kiln_bsdf_under(KILN_STRUCT kiln_bsdf_lobes l, float let_in, float kept, float share)
{
    const float normal = kiln_fresnel_normal(l.face.index), largest = kiln_bsdf_largest(l.p.specular_color);
    const float low = kiln_bsdf_scaled(l.p, normal, normal, largest),
                high = kiln_bsdf_scaled(l.p, 1.0f, normal, largest);
    return float_max(let_in - low * kept - (high - low) * share, KILN_FLOAT_TINY);
}

KILN_FUNCTION void kiln_curve_add(KILN_INOUT(KILN_STRUCT kiln_curve) sum, KILN_STRUCT kiln_curve a, float weight)
{
    KILN_AT(sum).c[0] += weight * a.c[0];
    KILN_AT(sum).c[1] += weight * a.c[1];
    KILN_AT(sum).c[2] += weight * a.c[2];
    KILN_AT(sum).c[3] += weight * a.c[3];
    KILN_AT(sum).c[4] += weight * a.c[4];
    KILN_AT(sum).c[5] += weight * a.c[5];
    KILN_AT(sum).c[6] += weight * a.c[6];
    KILN_AT(sum).c[7] += weight * a.c[7];
    KILN_AT(sum).c[8] += weight * a.c[8];
}

/* Interpolates the means of four layers from `layer` on, at coordinate `part` relative to it. */
KILN_FUNCTION KILN_STRUCT kiln_brushed_means kiln_brushed_means_at(KILN_U32 low, KILN_U32 high, KILN_I32 layer,
                                                                   float part)
{
    KILN_STRUCT kiln_brushed_means sum = KILN_BRUSHED_TABLE(low, high, layer).means;
    for (KILN_I32 k = 0; k < 4; k++) { /* layer 0 is already in the sum with weight 1 */
        const float weight = kiln_brushed_weight(k, part) - (k == 0 ? 1.0f : 0.0f);
        const KILN_STRUCT kiln_brushed_means m = KILN_BRUSHED_TABLE(low, high, layer + k).means;
        sum.lost += weight * m.lost;
        sum.glass_front += weight * m.glass_front;
        sum.glass_back += weight * m.glass_back;
        sum.glass_coat += weight * m.glass_coat;
        sum.trapped += weight * m.trapped;
        sum.in_front += weight * m.in_front;
        sum.kept_front += weight * m.kept_front;
        sum.share_front += weight * m.share_front;
        sum.in_back += weight * m.in_back;
        sum.kept_back += weight * m.kept_back;
        sum.share_back += weight * m.share_back;
        kiln_curve_add(KILN_TO(sum.face_lost), m.face_lost, weight);
        kiln_curve_add(KILN_TO(sum.face_effective), m.face_effective, weight);
    }
    return sum;
}

/* Sets the brushed layers that lobes use, by roughness, and fills in the means. */
KILN_FUNCTION void kiln_bsdf_take_layers(KILN_INOUT(KILN_STRUCT kiln_bsdf_lobes) l, KILN_U32 low, KILN_U32 high)
{
    const float first = KILN_BRUSHED_TABLE(low, high, 0).first, last = KILN_BRUSHED_TABLE(low, high, 0).last;
    const float alpha = float_min(KILN_AT(l).p.alpha_x, KILN_AT(l).p.alpha_y);
    const float place = float_min(float_max(kiln_brushed_layer(alpha), first), last) - first;
    const KILN_I32 layer = KILN_TO_I32(float_max(float_min(place - 1.0f, last - first - 3.0f), 0.0f));
    const float part = place - KILN_TO_F32(layer);
    KILN_STRUCT kiln_brushed_means m = KILN_BRUSHED_TABLE(low, high, layer).means;
    kiln_brushed_step(low, high, layer, KILN_TO(KILN_AT(l).brushed_low), KILN_TO(KILN_AT(l).brushed_high));
    KILN_AT(l).brushed_part = part;
    if (part != 0.0f)
        m = kiln_brushed_means_at(low, high, layer, part);
    KILN_AT(l).face.lost = m.face_lost;
    KILN_AT(l).face.effective = m.face_effective;
    KILN_AT(l).lost_mean = m.lost;
    KILN_AT(l).glass_lost_front = m.glass_front;
    KILN_AT(l).glass_lost_back = m.glass_back;
    KILN_AT(l).glass_lost_coat = m.glass_coat;
    KILN_AT(l).holds = kiln_bsdf_holds(KILN_AT(l)) ? 1u : 0u;
    KILN_AT(l).trapped_mean = KILN_AT(l).holds != 0u ? m.trapped : 0.0f;
    KILN_AT(l).under_front = 1.0f;
    KILN_AT(l).under_back = 1.0f;
    if (KILN_AT(l).matt > 0.0f) {
        KILN_AT(l).under_front = kiln_bsdf_under(KILN_AT(l), m.in_front, m.kept_front, m.share_front);
        KILN_AT(l).under_back = kiln_bsdf_under(KILN_AT(l), m.in_back, m.kept_back, m.share_back);
    }
}

KILN_FUNCTION float kiln_between(float a, float b, float part) { return (1.0f - part) * a + part * b; }

/* Fills in `holds`, `trapped` and `trapped_mean` by a table. */
KILN_FUNCTION void kiln_bsdf_take_trapped(KILN_INOUT(KILN_STRUCT kiln_bsdf_lobes) l, KILN_U32 low, KILN_U32 high)
{
    if (!kiln_bsdf_holds(KILN_AT(l)) || KILN_AT(l).base_is_mirror != 0u)
        return;
    const float steps = KILN_TO_F32(KILN_BSDF_TRAPPED_LAYERS - 1), coats = KILN_TO_F32(KILN_BSDF_TRAPPED_COATS - 1);
    const float first = KILN_BSDF_TRAPPED_TABLE(low, high).first, last = KILN_BSDF_TRAPPED_TABLE(low, high).last;
    const float coat_first = KILN_BSDF_TRAPPED_TABLE(low, high).coat_first,
                coat_last = KILN_BSDF_TRAPPED_TABLE(low, high).coat_last;
    const float r = float_min(float_max(float_sqrt(KILN_AT(l).p.alpha_x) * steps, first), last) - first;
    const float s =
        float_min(float_max(float_sqrt(KILN_AT(l).p.coat_alpha) * coats, coat_first), coat_last) - coat_first;
    const KILN_I32 i = KILN_TO_I32(float_max(float_min(r, last - first - 1.0f), 0.0f));
    const KILN_I32 j = KILN_TO_I32(float_max(float_min(s, coat_last - coat_first - 1.0f), 0.0f));
    const KILN_I32 i_next = last > first ? i + 1 : i, j_next = coat_last > coat_first ? j + 1 : j;
    const float a = r - KILN_TO_F32(i), b = s - KILN_TO_F32(j);
    for (KILN_I32 k = 0; k < KILN_TRAPPED_POINTS; k++) {
        const float bare = kiln_between(KILN_BSDF_TRAPPED_TABLE(low, high).bare[i].c[k],
                                        KILN_BSDF_TRAPPED_TABLE(low, high).bare[i_next].c[k], a);
        const float here =
            kiln_between(KILN_BSDF_TRAPPED_TABLE(low, high).coated[KILN_BSDF_TRAPPED_LAYERS * j + i].c[k],
                         KILN_BSDF_TRAPPED_TABLE(low, high).coated[KILN_BSDF_TRAPPED_LAYERS * j + i_next].c[k], a);
        const float there =
            kiln_between(KILN_BSDF_TRAPPED_TABLE(low, high).coated[KILN_BSDF_TRAPPED_LAYERS * j_next + i].c[k],
                         KILN_BSDF_TRAPPED_TABLE(low, high).coated[KILN_BSDF_TRAPPED_LAYERS * j_next + i_next].c[k], a);
        KILN_AT(l).trapped.c[k] = kiln_between(bare, kiln_between(here, there, b), KILN_AT(l).coat.strength);
    }
    KILN_AT(l).holds = 1u;
    kiln_bsdf_mean_trapped(l);
}

/* Prepares the lobes at a hit, with the tables of its material. */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_lobes kiln_bsdf_prepare_hit(KILN_STRUCT kiln_bsdf p,
                                                                KILN_STRUCT kiln_bsdf_tables tables)
{
    KILN_STRUCT kiln_bsdf_lobes l = kiln_bsdf_begin(p);
    if (KILN_BRUSHED_THERE && (tables.brushed_low | tables.brushed_high) != 0u && l.base_is_mirror == 0u)
        kiln_bsdf_take_layers(KILN_TO(l), tables.brushed_low, tables.brushed_high);
    else
        kiln_bsdf_means(KILN_TO(l));
    if (KILN_BSDF_TRAPPED_THERE && (tables.trapped_low | tables.trapped_high) != 0u)
        kiln_bsdf_take_trapped(KILN_TO(l), tables.trapped_low, tables.trapped_high);
    kiln_bsdf_dye(KILN_TO(l), p.base_color);
    return l;
}

/* Prepares the lobes of a material without tables. Takes some tenths of a millisecond for a coat over rough glass. */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_lobes kiln_bsdf_prepare(KILN_STRUCT kiln_bsdf p)
{
    KILN_STRUCT kiln_bsdf_lobes l = kiln_bsdf_begin(p);
    kiln_bsdf_means(KILN_TO(l));
    kiln_bsdf_dye(KILN_TO(l), p.base_color);
    kiln_bsdf_find_trapped(KILN_TO(l));
    return l;
}

#endif
