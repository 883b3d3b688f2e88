/* Albedo of a rough GGX interface after one scattering, as fitted polynomials, in float. From it follow the energy lost
 * between facets, which shaders/shared/bsdf.h adds again (Kulla and Conty, "Revisiting Physically Based Shading at
 * Imageworks", SIGGRAPH course 2017), and the light that is left for the layer beneath.
 *
 * Variables of the fits: `mu`, the cosine to the normal; roughness alpha, 0.001 to 1; `index`, the refractive index of
 * the denser medium over that of the other, clamped to 1.05 to 3. tests/bench/albedo_fit.py makes the fits. For given
 * alpha and index there remains a `curve`: a polynomial in near = sqrt(mu / (mu + 2 alpha)). */
#ifndef KILN_SHADERS_SHARED_MICROFACET_ALBEDO_H
#define KILN_SHADERS_SHARED_MICROFACET_ALBEDO_H

#include "shaders/shared/fresnel.h"
#include "shaders/shared/microfacet_fit.h"

/* Below this roughness a surface is a mirror: it sends light on in one direction. */
#define KILN_MIRROR_ALPHA 1.0e-3f

struct kiln_curve {
    float c[9]; /* coefficients of powers of 2 near - 1 */
};
KILN_FUNCTION float kiln_curve_at(KILN_STRUCT kiln_curve curve, float x)
{
    const float high = ((curve.c[8] * x + curve.c[7]) * x + curve.c[6]) * x + curve.c[5];
    return ((((high * x + curve.c[4]) * x + curve.c[3]) * x + curve.c[2]) * x + curve.c[1]) * x + curve.c[0];
}
/* Argument of a curve: 2 near - 1. */
KILN_FUNCTION float kiln_curve_place(float mu, float alpha)
{
    return 2.0f * float_sqrt(mu / float_max(mu + 2.0f * alpha, KILN_FLOAT_TINY)) - 1.0f;
}
/* Maps the index to the fits' variable, -1 to 1. */
KILN_FUNCTION float kiln_fit_index(float index)
{
    return 2.0f * float_sqrt(1.5f * (1.0f - 1.0f / float_min(float_max(index, 1.05f), 3.0f))) - 1.0f;
}

/* Reflection of a medium's interface, seen from outside. */
struct kiln_interface {
    float alpha, index;
    KILN_STRUCT kiln_curve lost;      /* 1 - albedo of a perfect reflector: error 0.0003 */
    KILN_STRUCT kiln_curve effective; /* the cosine at which a smooth interface reflects the same share */
};

KILN_FUNCTION KILN_STRUCT kiln_interface kiln_interface_of(float alpha, float index)
{
    KILN_STRUCT kiln_interface s;
    const float rough = alpha < KILN_MIRROR_ALPHA ? 0.0f : 1.0f; /* a mirror loses nothing */
    const float r = 2.0f * float_sqrt(alpha) - 1.0f, z = kiln_fit_index(index);
    s.alpha = alpha;
    s.index = index;
    for (int i = 0; i < 9; i++) {
        float sum = 0.0f;
        for (int j = 7; j >= 0; j--)
            sum = sum * r + KILN_FIT_WHOLE[8 * i + j];
        s.lost.c[i] = rough * sum;
    }
    for (int i = 0; i < 9; i++) {
        float sum = 0.0f;
        for (int j = 3; j >= 0 && i < 5; j--) {
            const int k = 12 * i + 3 * j;
            sum = sum * r + (KILN_FIT_EFFECTIVE[k] + z * (KILN_FIT_EFFECTIVE[k + 1] + z * KILN_FIT_EFFECTIVE[k + 2]));
        }
        s.effective.c[i] = rough * sum;
    }
    return s;
}

/* Clamps a fit's lost share to its bounds, which are small for flat facets. */
KILN_FUNCTION float kiln_lost(float fit, float mu, float alpha)
{
    const float slope = 2.0f * alpha / float_max(mu, KILN_FLOAT_TINY);
    return float_max(float_min(fit, float_min(slope, 1.0f) * float_min(slope, 1.0f)), 0.0f);
}
/* Share of light that a perfect reflector loses, 0 to 1. */
KILN_FUNCTION float kiln_interface_lost(KILN_STRUCT kiln_interface s, float mu)
{
    return kiln_lost(kiln_curve_at(s.lost, kiln_curve_place(mu, s.alpha)), mu, s.alpha);
}
/* Mean exact Fresnel reflectance over the facets visible at mu, weighted by what they reflect. Multiplied by the
 * perfect reflector's albedo it is the reflected share: error 0.005. */
KILN_FUNCTION float kiln_interface_fresnel(KILN_STRUCT kiln_interface s, float mu)
{
    const float off = float_sqrt(s.alpha) * kiln_curve_at(s.effective, kiln_curve_place(mu, s.alpha));
    return kiln_fresnel(float_min(float_max(mu + off, 0.0f), 1.0f), s.index);
}
KILN_FUNCTION float kiln_interface_albedo(KILN_STRUCT kiln_interface s, float mu)
{
    return (1.0f - kiln_interface_lost(s, mu)) * kiln_interface_fresnel(s, mu);
}

/* ---- energy lost by anisotropic (brushed) facets ---- */

/* Coefficient i of the curve: a polynomial in a, t and r. Written without loops: GPU compilers keep a table that a loop
 * reads in memory, or turn it into a ladder of branches at each call. */
#define KILN_ACROSS_A(n)                                                                                               \
    (((KILN_FIT_ACROSS[(n) + 3] * a + KILN_FIT_ACROSS[(n) + 2]) * a + KILN_FIT_ACROSS[(n) + 1]) * a +                  \
     KILN_FIT_ACROSS[n])
#define KILN_ACROSS_T(n)                                                                                               \
    (((KILN_ACROSS_A((n) + 12) * t + KILN_ACROSS_A((n) + 8)) * t + KILN_ACROSS_A((n) + 4)) * t + KILN_ACROSS_A(n))
#define KILN_ACROSS(i)                                                                                                 \
    ((((KILN_ACROSS_T(80 * (i) + 64) * r + KILN_ACROSS_T(80 * (i) + 48)) * r + KILN_ACROSS_T(80 * (i) + 32)) * r +     \
      KILN_ACROSS_T(80 * (i) + 16)) *                                                                                  \
         r +                                                                                                           \
     KILN_ACROSS_T(80 * (i)))

/* As kiln_interface_lost, for two roughnesses: error 0.006. The loss depends on `along`, the roughness in the plane of
 * the direction, and on both roughnesses: rough facets scatter light sideways that comes along smooth ones. */
KILN_FUNCTION float kiln_across_lost(KILN_VECTOR w, float alpha_x, float alpha_y)
{
    const float wide = float_max(alpha_x, alpha_y), narrow = float_min(alpha_x, alpha_y);
    const float x = w.x * w.x, y = w.y * w.y, mu = float_abs(w.z);
    const float slope = float_sqrt((alpha_x * alpha_x * x + alpha_y * alpha_y * y) / float_max(x + y, KILN_FLOAT_TINY));
    const float along = float_min(float_max(slope, narrow), wide);
    const float r = 2.0f * float_sqrt(wide) - 1.0f, t = 2.0f * float_sqrt(narrow / wide) - 1.0f;
    const float a = 2.0f * along / wide - 1.0f, at = kiln_curve_place(mu, along);
    float sum = KILN_ACROSS(7);
    sum = sum * at + KILN_ACROSS(6);
    sum = sum * at + KILN_ACROSS(5);
    sum = sum * at + KILN_ACROSS(4);
    sum = sum * at + KILN_ACROSS(3);
    sum = sum * at + KILN_ACROSS(2);
    sum = sum * at + KILN_ACROSS(1);
    sum = sum * at + KILN_ACROSS(0);
    return kiln_lost(sum, mu, wide);
}
#undef KILN_ACROSS
#undef KILN_ACROSS_T
#undef KILN_ACROSS_A

/* ---- energy lost at a rough glass boundary, reflected and refracted light together ---- */

struct kiln_boundary {
    float alpha, critical;                /* cosine of the critical angle in the denser medium */
    KILN_STRUCT kiln_curve thin;          /* lost share of light from the medium with the lower index: error 0.003 */
    KILN_STRUCT kiln_curve dense, beyond; /* from the denser one; its change beyond the critical angle: 0.004 */
};

/* Coefficients of the curves. The calls below are not loops: GPU compilers keep an array that a loop writes in memory,
 * and copy it at each call that it is passed to. */
KILN_FUNCTION float kiln_fit_thin(int i, float r, float z)
{
    float sum = 0.0f;
    for (int j = 5; j >= 0; j--) {
        const int k = 24 * i + 4 * j;
        sum = sum * r +
              (KILN_FIT_LOST[k] + z * (KILN_FIT_LOST[k + 1] + z * (KILN_FIT_LOST[k + 2] + z * KILN_FIT_LOST[k + 3])));
    }
    return sum;
}
KILN_FUNCTION float kiln_fit_dense(int i, float r, float z)
{
    float sum = 0.0f;
    for (int j = 5; j >= 0; j--) {
        const int k = 24 * i + 4 * j;
        sum = sum * r + (KILN_FIT_DENSE[k] +
                         z * (KILN_FIT_DENSE[k + 1] + z * (KILN_FIT_DENSE[k + 2] + z * KILN_FIT_DENSE[k + 3])));
    }
    return sum;
}
KILN_FUNCTION float kiln_fit_beyond(int i, float r, float z)
{
    float sum = 0.0f;
    for (int j = 5; j >= 0; j--) {
        const int k = 24 * i + 4 * j;
        sum = sum * r + (KILN_FIT_BEYOND[k] +
                         z * (KILN_FIT_BEYOND[k + 1] + z * (KILN_FIT_BEYOND[k + 2] + z * KILN_FIT_BEYOND[k + 3])));
    }
    return sum;
}

KILN_FUNCTION KILN_STRUCT kiln_boundary kiln_boundary_of(float alpha, float index)
{
    KILN_STRUCT kiln_boundary s;
    const float r = 2.0f * float_sqrt(alpha) - 1.0f, z = kiln_fit_index(index);
    s.alpha = alpha;
    s.critical = float_sqrt(float_max(0.0f, 1.0f - 1.0f / (index * index)));
    s.thin.c[0] = kiln_fit_thin(0, r, z);
    s.thin.c[1] = kiln_fit_thin(1, r, z);
    s.thin.c[2] = kiln_fit_thin(2, r, z);
    s.thin.c[3] = kiln_fit_thin(3, r, z);
    s.thin.c[4] = kiln_fit_thin(4, r, z);
    s.thin.c[5] = kiln_fit_thin(5, r, z);
    s.thin.c[6] = kiln_fit_thin(6, r, z);
    s.thin.c[7] = kiln_fit_thin(7, r, z);
    s.thin.c[8] = 0.0f;
    s.dense.c[0] = kiln_fit_dense(0, r, z);
    s.dense.c[1] = kiln_fit_dense(1, r, z);
    s.dense.c[2] = kiln_fit_dense(2, r, z);
    s.dense.c[3] = kiln_fit_dense(3, r, z);
    s.dense.c[4] = kiln_fit_dense(4, r, z);
    s.dense.c[5] = kiln_fit_dense(5, r, z);
    s.dense.c[6] = kiln_fit_dense(6, r, z);
    s.dense.c[7] = kiln_fit_dense(7, r, z);
    s.dense.c[8] = 0.0f;
    s.beyond.c[0] = kiln_fit_beyond(0, r, z);
    s.beyond.c[1] = kiln_fit_beyond(1, r, z);
    s.beyond.c[2] = kiln_fit_beyond(2, r, z);
    s.beyond.c[3] = kiln_fit_beyond(3, r, z);
    s.beyond.c[4] = kiln_fit_beyond(4, r, z);
    s.beyond.c[5] = kiln_fit_beyond(5, r, z);
    s.beyond.c[6] = kiln_fit_beyond(6, r, z);
    s.beyond.c[7] = kiln_fit_beyond(7, r, z);
    s.beyond.c[8] = 0.0f;
    return s;
}

KILN_FUNCTION float kiln_boundary_lost(KILN_STRUCT kiln_boundary s, float mu, bool dense)
{
    const float at = kiln_curve_place(mu, s.alpha), x = mu - s.critical;
    const float step = 0.5f + 0.5f * x / float_sqrt(x * x + 0.25f * s.alpha * s.alpha + 1.0e-6f);
    const float lost =
        dense ? kiln_curve_at(s.dense, at) + step * kiln_curve_at(s.beyond, at) : kiln_curve_at(s.thin, at);
    return kiln_lost(lost, mu, s.alpha);
}

/* ---- a clear coat over a rough base ---- */

struct kiln_coat {
    float strength; /* 0: there is none */
    float partial;  /* share of the base whose facets do not send on all light: diffuse layer, glass body */
    KILN_STRUCT kiln_interface face;
    float base_alpha;
    KILN_STRUCT kiln_curve effective; /* effective cosine at which light from base and coat leaves */
};

KILN_FUNCTION float kiln_fit_coat(int i, float r, float z)
{
    float sum = 0.0f;
    for (int j = 7; j >= 0; j--) {
        const int k = 40 * i + 5 * j;
        sum = sum * r + (KILN_FIT_COAT[k] +
                         z * (KILN_FIT_COAT[k + 1] +
                              z * (KILN_FIT_COAT[k + 2] + z * (KILN_FIT_COAT[k + 3] + z * KILN_FIT_COAT[k + 4]))));
    }
    return sum;
}
KILN_FUNCTION KILN_STRUCT kiln_coat kiln_coat_of(float strength, float alpha, float base_alpha, float partial)
{
    KILN_STRUCT kiln_coat s;
    const float r = 2.0f * float_sqrt(base_alpha) - 1.0f, z = 2.0f * float_sqrt(alpha) - 1.0f;
    s.strength = strength;
    s.partial = partial;
    s.face = kiln_interface_of(alpha, KILN_COAT_INDEX);
    s.base_alpha = base_alpha;
    s.effective.c[0] = kiln_fit_coat(0, r, z);
    s.effective.c[1] = kiln_fit_coat(1, r, z);
    s.effective.c[2] = kiln_fit_coat(2, r, z);
    s.effective.c[3] = kiln_fit_coat(3, r, z);
    s.effective.c[4] = kiln_fit_coat(4, r, z);
    s.effective.c[5] = kiln_fit_coat(5, r, z);
    s.effective.c[6] = kiln_fit_coat(6, r, z);
    s.effective.c[7] = kiln_fit_coat(7, r, z);
    s.effective.c[8] = kiln_fit_coat(8, r, z);
    return s;
}

/* Share of light that the coat reflects. */
KILN_FUNCTION float kiln_coat_albedo(KILN_STRUCT kiln_coat s, float mu)
{
    return s.strength * kiln_interface_albedo(s.face, mu);
}
/* Factor of the base's scattering for one direction; the base is multiplied by the factors of both directions. With it
 * a white base sends on, from each direction, exactly what the coat lets in: h(o) integral h(i) f(o, i) |cos| di = 1 -
 * coat albedo(o), to 0.003 (balanced after Sinkhorn). For a mirror the factor is sqrt(1 - E), for a matt surface (1 -
 * E) / sqrt(1 - mean E). Facets of a dielectric reflect more towards the horizon, where the coat lets less out: their
 * factor is nearer to the mirror's. */
KILN_FUNCTION float kiln_coat_factor(KILN_STRUCT kiln_coat s, float mu)
{
    const float scale = s.base_alpha / float_sqrt(float_max(mu + s.base_alpha, KILN_FLOAT_TINY));
    const float off = scale * kiln_curve_at(s.effective, kiln_curve_place(mu, s.base_alpha));
    const float leaves = float_min(float_max(mu + off, 0.0f), 1.0f);
    const float through = 1.0f - kiln_coat_albedo(s, mu);
    const float metal = through / float_sqrt(1.0f - 0.9999f * kiln_coat_albedo(s, leaves));
    return metal + s.partial * float_min((3.0f - s.base_alpha) * mu, 1.0f) * (float_sqrt(through) - metal);
}

/* ---- cosine-weighted means over a hemisphere: Gauss's rule in the square root of the cosine ---- */

#define KILN_MEAN_POINTS 8
KILN_CONSTANT float KILN_MEAN_COSINES[8] = {0.000394223874f, 0.0103361304f, 0.0562798735f, 0.166694746f,
                                            0.350129388f,    0.581812283f,  0.807002608f,  0.96068408f};
KILN_CONSTANT float KILN_MEAN_WEIGHTS[8] = {1.58470101e-06f, 0.000467374172f, 0.00837690102f, 0.0493674846f,
                                            0.150279929f,    0.278437704f,    0.322433494f,   0.190635529f};

#endif
