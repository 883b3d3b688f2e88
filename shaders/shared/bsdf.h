/* Scattering functions (BSDF) of whole materials, in float, the same in C and GLSL: values f(o, i), sampling, forward
 * and reverse densities, albedos.
 *
 * Directions are unit, point away from the surface, and are given in the frame whose z is the shading normal of the
 * front and whose x is the tangent of anisotropy; z < 0 lies behind the face. o is where a path came from, i where it
 * goes on. Along paths from the eye (KILN_RADIANCE) light arrives from i and leaves to o; along paths from lights
 * (KILN_IMPORTANCE) it arrives from o and leaves to i. The two differ by the square of the indices where light is
 * refracted: f(o, i) of one is f(i, o) of the other (Veach, "Robust Monte Carlo Methods for Light Transport
 * Simulation", 1997, section 5.2). Importance also needs kiln_shading_correction if the shading normal is not the
 * geometric one.
 *
 * `lobes` selects parts: KILN_LOBE_DIFFUSE is the diffuse surface, KILN_LOBE_GLOSS the rest of the base, KILN_LOBE_COAT
 * the clear coat's reflection. Mirrors and smooth glass are deltas without a density: kiln_bsdf_evaluate and
 * kiln_bsdf_density leave them out, kiln_bsdf_draw sets `delta`. */
#ifndef KILN_SHADERS_SHARED_BSDF_H
#define KILN_SHADERS_SHARED_BSDF_H

#include "shaders/shared/bsdf_lobes.h"

#define KILN_RADIANCE 0u
#define KILN_IMPORTANCE 1u

#define KILN_LOBE_DIFFUSE 1u
#define KILN_LOBE_GLOSS 2u
#define KILN_LOBE_COAT 4u
#define KILN_LOBE_ALL 7u

/* Lobes that a kernel ever asks for; it has no code for values of others. KILN_LOBES_MAY_BE: some of these. */
#ifndef KILN_LOBES_ASKED
#    define KILN_LOBES_ASKED KILN_LOBE_ALL
#endif
#define KILN_LOBES_MAY_BE(lobes) ((KILN_LOBES_ASKED & (lobes)) != 0u)

/* ---- albedos and choices ---- */

/* Approximate albedos of the lobes for light from a direction; the probabilities of lobes derive from them. */
struct kiln_bsdf_albedo {
    KILN_VECTOR diffuse, gloss, coat;
    KILN_VECTOR spread_near, spread_far; /* multiple scattering of facets, on the direction's side and on the other */
};

/* Probabilities of sampling each lobe; their sum is 1, or all are 0. */
struct kiln_bsdf_choice {
    float coat, gloss, diffuse, near, far;
};

/* Reflectance and transmittance of a facet of the base, and the probability of sampling reflection. */
struct kiln_bsdf_split {
    KILN_VECTOR reflected, through;
    float chance;
};

KILN_FUNCTION KILN_VECTOR kiln_bsdf_metal(KILN_VECTOR color, float cosine)
{
    const float share = kiln_schlick_share(cosine);
    return vec3(color.x + (1.0f - color.x) * share, color.y + (1.0f - color.y) * share,
                color.z + (1.0f - color.z) * share);
}

KILN_FUNCTION KILN_STRUCT kiln_bsdf_split kiln_bsdf_split_at(KILN_STRUCT kiln_bsdf_lobes l, bool front, float cosine)
{
    KILN_STRUCT kiln_bsdf_split s;
    s.through = vec3(0.0f, 0.0f, 0.0f);
    s.reflected = vec3_scale(kiln_bsdf_metal(l.p.base_color, cosine), l.metal);
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_OLDER) && l.p.model == KILN_BSDF_COOK_TORRANCE)
        s.reflected = kiln_bsdf_metal(l.p.specular_color, cosine);
    if (l.matt > 0.0f && l.p.model == KILN_BSDF_LAYERS)
        s.reflected =
            vec3_madd(s.reflected, kiln_bsdf_fresnel_at(l.p, cosine, kiln_bsdf_eta(l.p, true)).reflected, l.matt);
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_GLASS) && l.glass > 0.0f) {
        const KILN_VECTOR eta = kiln_bsdf_eta(l.p, front);
        KILN_STRUCT kiln_bsdf_fresnel f = kiln_bsdf_fresnel_at(l.p, cosine, eta);
        if (KILN_BSDF_MAY(KILN_BSDF_MAY_COAT) && !front && l.coat.strength > 0.0f &&
            l.p.thin_wall == 0u) { /* the coat reflects part of the transmitted light back */
            const float outside = kiln_refracted_cosine(cosine, eta.y);
            f.reflected =
                vec3_madd(f.reflected, f.through, kiln_bsdf_mirrored_share(l) * kiln_coat_albedo(l.coat, outside));
        }
        s.reflected = vec3_madd(s.reflected, f.reflected, l.glass);
        s.through = vec3_scale(vec3_mul(f.through, l.p.base_color), l.glass);
    }
    const float back = kiln_bsdf_luminance(s.reflected), on = kiln_bsdf_luminance(s.through);
    s.chance = on > 0.0f ? back / (back + on) : 1.0f;
    return s;
}

/* Multiple scattering (energy compensation) of rough glass, on the same side and on the other: l(o) l(i) n(i)^2 / (pi
 * sum over both sides of n^2 mean l), where l is the fraction that single scattering loses from a direction. Light that
 * has been scattered often leaves as in a furnace, independently of its origin. */
struct kiln_bsdf_forgotten {
    KILN_VECTOR same, other; /* without l(i) / pi; `other` with n(i)^2, which is importance */
};
KILN_FUNCTION float kiln_bsdf_forgotten_sum(KILN_STRUCT kiln_bsdf_lobes l, float squared)
{
    return float_max(l.glass_lost_front + squared * l.glass_lost_back, KILN_FLOAT_TINY);
}
KILN_FUNCTION KILN_STRUCT kiln_bsdf_forgotten kiln_bsdf_forgotten_of(KILN_STRUCT kiln_bsdf_lobes l, bool front,
                                                                     KILN_VECTOR w, float facets)
{
    KILN_STRUCT kiln_bsdf_forgotten s;
    const float lost = l.glass * kiln_bsdf_glass_lost(l, front, w, facets);
    const KILN_VECTOR squared = l.p.thin_wall != 0u ? vec3(1.0f, 1.0f, 1.0f) : vec3_mul(l.p.eta, l.p.eta);
    const KILN_VECTOR of_front =
        vec3(lost / kiln_bsdf_forgotten_sum(l, squared.x), lost / kiln_bsdf_forgotten_sum(l, squared.y),
             lost / kiln_bsdf_forgotten_sum(l, squared.z));
    const KILN_VECTOR of_back = vec3_mul(of_front, squared);
    s.same = front ? of_front : of_back;
    s.other = front ? of_back : of_front;
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_COAT) && l.coat.strength > 0.0f && l.p.thin_wall == 0u) {
        if (front) /* the coat admits less light, and light that it reflects on the way out is scattered again */
            s.same = vec3_scale(s.same, l.glass_lost_front / float_max(l.glass_lost_coat, KILN_FLOAT_TINY));
        else
            s.same =
                vec3_madd(s.same, of_front,
                          (l.glass_lost_front - l.glass_lost_coat) / float_max(l.glass_lost_back, KILN_FLOAT_TINY));
    }
    return s;
}

KILN_FUNCTION KILN_STRUCT kiln_bsdf_albedo kiln_bsdf_albedo_of(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR o)
{
    KILN_STRUCT kiln_bsdf_albedo a;
    const bool front = o.z > 0.0f;
    const float mu = float_abs(o.z), coat = kiln_bsdf_coat_albedo(l, front, mu), rest = 1.0f - coat;
    const float lost = kiln_bsdf_facets_lost(l, o), base = l.matt > 0.0f ? l.matt * kiln_diffuse_in(l, o) : 0.0f;
    a.coat = kiln_bsdf_gray(coat);
    a.diffuse = vec3_scale(l.p.base_color, base);
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_OLDER) && l.p.model == KILN_BSDF_PHONG)
        a.gloss = l.p.specular_color;
    else {
        const KILN_STRUCT kiln_bsdf_split s = kiln_bsdf_split_at(l, front, mu);
        a.gloss = vec3_scale(vec3_add(s.reflected, s.through), rest * (1.0f - lost));
    }
    a.spread_near = vec3_scale(l.metal_spread, rest * l.metal * lost);
    a.spread_far = vec3(0.0f, 0.0f, 0.0f);
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_ROUGH_GLASS) && l.glass > 0.0f && l.base_is_mirror == 0u) {
        const KILN_STRUCT kiln_bsdf_forgotten f = kiln_bsdf_forgotten_of(l, front, o, lost);
        const float here = front ? l.glass_lost_coat : l.glass_lost_back;
        const float there = front ? l.glass_lost_back : l.glass_lost_coat;
        a.spread_near = vec3_madd(a.spread_near, f.same, rest * here);
        if (!front && l.trapped_mean > 0.0f)
            a.spread_near = vec3_add(a.spread_near, kiln_bsdf_gray(l.glass * kiln_bsdf_trapped(l, o)));
        a.spread_far = vec3_scale(vec3_mul(l.p.base_color, f.other), rest * there);
    }
    return a;
}

/* Computes the luminances of the albedos. kiln_bsdf_choice_of turns them into probabilities for a set of lobes; several
 * sets can share the luminances. */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_choice kiln_bsdf_shares_of(KILN_STRUCT kiln_bsdf_albedo a)
{
    KILN_STRUCT kiln_bsdf_choice c;
    c.coat = a.coat.x;
    c.diffuse = kiln_bsdf_luminance(a.diffuse);
    c.gloss = kiln_bsdf_luminance(a.gloss);
    c.near = kiln_bsdf_luminance(a.spread_near);
    c.far = kiln_bsdf_luminance(a.spread_far);
    return c;
}
KILN_FUNCTION KILN_STRUCT kiln_bsdf_choice kiln_bsdf_shares(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR o)
{
    return kiln_bsdf_shares_of(kiln_bsdf_albedo_of(l, o));
}
KILN_FUNCTION KILN_STRUCT kiln_bsdf_choice kiln_bsdf_choice_of(KILN_STRUCT kiln_bsdf_choice shares, KILN_U32 lobes)
{
    const bool gloss = (lobes & KILN_LOBE_GLOSS) != 0u;
    KILN_STRUCT kiln_bsdf_choice c;
    c.coat = (lobes & KILN_LOBE_COAT) != 0u ? shares.coat : 0.0f;
    c.diffuse = (lobes & KILN_LOBE_DIFFUSE) != 0u ? shares.diffuse : 0.0f;
    c.gloss = gloss ? shares.gloss : 0.0f;
    c.near = gloss ? shares.near : 0.0f;
    c.far = gloss ? shares.far : 0.0f;
    const float sum = c.coat + c.diffuse + c.gloss + c.near + c.far;
    const float scale = sum > 0.0f ? 1.0f / sum : 0.0f;
    c.coat *= scale;
    c.diffuse *= scale;
    c.gloss *= scale;
    c.near *= scale;
    c.far *= scale;
    return c;
}
KILN_FUNCTION KILN_STRUCT kiln_bsdf_choice kiln_bsdf_choose(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR o,
                                                            KILN_U32 lobes)
{
    return kiln_bsdf_choice_of(kiln_bsdf_shares(l, o), lobes);
}

/* ---- values and densities ---- */

/* Density for sampling multiple scattering of facets (kiln_bsdf_given_back). It is proportional to mu / (mu^2 + (2
 * alpha)^2), with mu the cosine. This approximates the lobe, since the fraction that facets lose falls with (alpha /
 * mu)^2. */
KILN_FUNCTION float kiln_bsdf_spread_norm(float alpha) { return float_log(1.0f + 0.25f / (alpha * alpha)); }
KILN_FUNCTION float kiln_bsdf_spread_density(float alpha, float mu)
{
    return KILN_INVERSE_PI * mu / ((mu * mu + 4.0f * alpha * alpha) * kiln_bsdf_spread_norm(alpha));
}
KILN_FUNCTION KILN_VECTOR kiln_bsdf_spread_draw(float alpha, float u, float v)
{
    const float mu = float_min(2.0f * alpha * float_sqrt(float_exp(v * kiln_bsdf_spread_norm(alpha)) - 1.0f), 1.0f);
    const float r = float_sqrt((1.0f - mu) * (1.0f + mu));
    float sine, cosine;
    kiln_turn(u, KILN_TO(sine), KILN_TO(cosine));
    return vec3(r * cosine, r * sine, mu);
}

struct kiln_bsdf_value {
    KILN_VECTOR value; /* f(o, i) |i.z|, per steradian */
    float density;     /* density with which kiln_bsdf_draw samples i from o, per steradian */
};

/* GGX reflection without Fresnel, for two directions on one side: value is D * G2 / (4 o.z i.z) * i.z, D of facets. */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_value kiln_bsdf_facets(KILN_VECTOR o, KILN_VECTOR i, KILN_VECTOR h, float alpha_x,
                                                           float alpha_y)
{
    KILN_STRUCT kiln_bsdf_value s;
    const float facets = kiln_ggx(h, alpha_x, alpha_y);
    const float so = kiln_ggx_stretch(o, alpha_x, alpha_y), si = kiln_ggx_stretch(i, alpha_x, alpha_y);
    const float value = 0.25f * facets * kiln_ggx_visible(o.z, i.z, so, si) * i.z;
    s.value = kiln_bsdf_gray(value);
    s.density = 0.25f * kiln_ggx_seen(facets, o.z, so);
    return s;
}

/* Correction of the reflection of kiln_bsdf_split_at, for light from behind that a coat over rough glass reflects into
 * the mirror direction. kiln_bsdf_split_at evaluates the coat's albedo at the cosine to the facet, kiln_bsdf_mirrored
 * at the cosines to the surface. Returns the difference. o, i and h are cosines to the surface, `cosine` is the cosine
 * to the facet. */
KILN_FUNCTION KILN_VECTOR kiln_bsdf_returned(KILN_STRUCT kiln_bsdf_lobes l, float o, float i, float h, float cosine)
{
    const KILN_VECTOR eta = kiln_bsdf_eta(l.p, false);
    const float outside = kiln_refracted_cosine(cosine, eta.y);
    const float more =
        kiln_bsdf_mirrored(l, o, i, h, cosine) - kiln_bsdf_mirrored_share(l) * kiln_coat_albedo(l.coat, outside);
    return vec3_scale(kiln_bsdf_fresnel_at(l.p, cosine, eta).through, l.glass * more);
}

/* Reflection by the base's facets; o and i on one side, both with z > 0. */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_value kiln_bsdf_reflection(KILN_STRUCT kiln_bsdf_lobes l, bool front, KILN_VECTOR o,
                                                               KILN_VECTOR i)
{
    const KILN_VECTOR h = kiln_direction_of(vec3_add(o, i));
    KILN_STRUCT kiln_bsdf_value s = kiln_bsdf_facets(o, i, h, l.alpha_x, l.alpha_y);
    const float cosine = 0.5f * (vec3_dot(o, h) + vec3_dot(i, h)); /* the same bits for i and o exchanged */
    const KILN_STRUCT kiln_bsdf_split split = kiln_bsdf_split_at(l, front, cosine);
    const float coat = kiln_bsdf_coat_factor(l, front, o) * kiln_bsdf_coat_factor(l, front, i);
    KILN_VECTOR reflected = split.reflected;
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_COAT) && !front && l.glass > 0.0f && l.coat.strength > 0.0f && l.p.thin_wall == 0u)
        reflected = vec3_add(reflected, kiln_bsdf_returned(l, o.z, i.z, h.z, cosine));
    s.value = vec3_scale(reflected, s.value.x * coat);
    s.density *= split.chance;
    return s;
}

/* Returns the coat's transmittance for light that crosses the face from one side to the other. */
KILN_FUNCTION float kiln_bsdf_crossing(KILN_STRUCT kiln_bsdf_lobes l, bool front, KILN_VECTOR o, KILN_VECTOR i)
{
    if (l.p.thin_wall != 0u)
        return kiln_bsdf_coat_factor(l, true, o) * kiln_bsdf_coat_factor(l, true, i);
    return 1.0f - kiln_bsdf_coat_albedo(l, true, float_abs(front ? o.z : i.z));
}

/* Refraction of one colour (Walter et al. 2007, equations 17 and 21), with o.z > 0 > i.z. `eta`: index behind the face
 * / index before it. The value is for radiance, without the transmittance of a facet; value and density have the same
 * bits from either side. The cosines are to the facet; 0 if no facet refracts o to i. */
struct kiln_bsdf_refraction {
    float value, density, cosine_o, cosine_i;
};
KILN_FUNCTION KILN_STRUCT kiln_bsdf_refraction kiln_bsdf_refract(KILN_STRUCT kiln_bsdf_lobes l, bool front,
                                                                 KILN_VECTOR o, KILN_VECTOR i, float eta)
{
    KILN_STRUCT kiln_bsdf_refraction s;
    s.value = 0.0f;
    s.density = 0.0f;
    s.cosine_o = 0.0f;
    s.cosine_i = 0.0f;
    const KILN_VECTOR sum = front ? vec3_madd(o, i, eta) : vec3_madd(i, o, eta);
    KILN_VECTOR h = kiln_direction_of(sum);
    if (h.z < 0.0f)
        h = vec3_scale(h, -1.0f);
    const float oh = vec3_dot(o, h), ih = -vec3_dot(i, h), squared = vec3_dot(sum, sum);
    if (!(oh > 0.0f) || !(ih > 0.0f) || !(squared > 0.0f))
        return s;
    const float facets = kiln_ggx(h, l.alpha_x, l.alpha_y);
    const float so = kiln_ggx_stretch(o, l.alpha_x, l.alpha_y), si = kiln_ggx_stretch(i, l.alpha_x, l.alpha_y);
    const float both = oh * ih / squared, behind = eta * eta;
    s.value = facets * kiln_ggx_visible(o.z, -i.z, so, si) * -i.z * both * (front ? 1.0f : behind);
    s.density = kiln_ggx_seen(facets, o.z, so) * both * (front ? behind : 1.0f);
    s.cosine_o = oh;
    s.cosine_i = ih;
    return s;
}

/* Refraction of one colour index with the facets' transmittance for each colour; the density includes the probability
 * of refraction. */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_value kiln_bsdf_refracted(KILN_STRUCT kiln_bsdf_lobes l, bool front, KILN_VECTOR o,
                                                              KILN_VECTOR i, float eta, KILN_U32 mode)
{
    KILN_STRUCT kiln_bsdf_value s;
    const KILN_STRUCT kiln_bsdf_refraction r = kiln_bsdf_refract(l, front, o, i, eta);
    const bool thin = front == (eta >= 1.0f); /* o lies in the medium with the lower index: there 1 - F is exact */
    const KILN_STRUCT kiln_bsdf_split split = kiln_bsdf_split_at(l, thin == front, thin ? r.cosine_o : r.cosine_i);
    const float squared = front ? eta * eta : 1.0f / (eta * eta);
    s.value = vec3_scale(split.through, r.value * (mode == KILN_IMPORTANCE ? squared : 1.0f));
    s.density = r.density * (1.0f - kiln_bsdf_split_at(l, front, r.cosine_o).chance);
    return s;
}

/* Transmission through rough glass; o.z > 0 > i.z. */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_value kiln_bsdf_transmission(KILN_STRUCT kiln_bsdf_lobes l, bool front,
                                                                 KILN_VECTOR o, KILN_VECTOR i, KILN_U32 mode)
{
    KILN_STRUCT kiln_bsdf_value s;
    if (l.p.thin_wall != 0u) {
        const KILN_VECTOR mirrored = vec3(i.x, i.y, -i.z), h = kiln_direction_of(vec3_add(o, mirrored));
        const KILN_STRUCT kiln_bsdf_split split = kiln_bsdf_split_at(l, front, vec3_dot(o, h));
        s = kiln_bsdf_facets(o, mirrored, h, l.alpha_x, l.alpha_y);
        s.value = vec3_mul(split.through, s.value);
        s.density *= 1.0f - split.chance;
        return s;
    }
    s.value = vec3(0.0f, 0.0f, 0.0f);
    s.density = 0.0f;
    /* each colour is sampled with equal probability */
    const int colors = KILN_BSDF_MAY(KILN_BSDF_MAY_DISPERSE) && l.disperses != 0u ? 3 : 1;
    for (int c = 0; c < colors; c++) {
        const float eta = c == 0 ? l.p.eta.x : c == 1 ? l.p.eta.y : l.p.eta.z;
        const KILN_STRUCT kiln_bsdf_value color = kiln_bsdf_refracted(l, front, o, i, eta, mode);
        s.value = colors == 1 ? color.value
                              : vec3(c == 0 ? color.value.x : s.value.x, c == 1 ? color.value.y : s.value.y,
                                     c == 2 ? color.value.z : s.value.z);
        s.density += color.density / KILN_TO_F32(colors);
    }
    return s;
}

/* Returns the value of multiple scattering by the base's facets; o.z > 0. */
KILN_FUNCTION KILN_VECTOR kiln_bsdf_given_back(KILN_STRUCT kiln_bsdf_lobes l, bool front, KILN_VECTOR o, KILN_VECTOR i,
                                               KILN_U32 mode)
{
    KILN_VECTOR sum = vec3(0.0f, 0.0f, 0.0f);
    const float mu = float_abs(i.z);
    if (l.base_is_mirror != 0u || (l.metal == 0.0f && l.glass == 0.0f))
        return sum;
    const float of_o = kiln_bsdf_facets_lost(l, o), of_i = kiln_bsdf_facets_lost(l, i);
    if (i.z > 0.0f && l.metal > 0.0f) {
        const float coat = kiln_bsdf_coat_factor(l, front, o) * kiln_bsdf_coat_factor(l, front, i);
        sum = vec3_scale(l.metal_spread, l.metal * coat * of_o * of_i / float_max(l.lost_mean, KILN_FLOAT_TINY));
    }
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_ROUGH_GLASS) && l.glass > 0.0f) {
        const bool same = i.z > 0.0f;
        const KILN_STRUCT kiln_bsdf_forgotten f = kiln_bsdf_forgotten_of(l, front, o, of_o);
        const float lost = kiln_bsdf_glass_lost(l, front == same, i, of_i);
        float coats = kiln_bsdf_crossing(l, front, o, i);
        if (same && l.p.thin_wall == 0u)
            coats = (1.0f - kiln_bsdf_coat_albedo(l, front, o.z)) * (1.0f - kiln_bsdf_coat_albedo(l, front, mu));
        if (same) {
            sum = vec3_madd(sum, f.same, lost * coats);
            if (!front && l.trapped_mean > 0.0f)
                sum = vec3_add(
                    sum, kiln_bsdf_gray(l.glass * kiln_bsdf_trapped(l, o) * kiln_bsdf_trapped(l, i) / l.trapped_mean));
        } else {
            const KILN_VECTOR eta = kiln_bsdf_eta(l.p, front);
            KILN_VECTOR color = vec3_mul(l.p.base_color, f.other);
            if (mode == KILN_RADIANCE && l.p.thin_wall == 0u)
                color = vec3(color.x / (eta.x * eta.x), color.y / (eta.y * eta.y), color.z / (eta.z * eta.z));
            sum = vec3_madd(sum, color, lost * coats);
        }
    }
    return vec3_scale(sum, mu * KILN_INVERSE_PI);
}

/* The specular part of Phong's and of Cook and Torrance's model. */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_value kiln_bsdf_older(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR o, KILN_VECTOR i)
{
    KILN_STRUCT kiln_bsdf_value s;
    if (l.p.model == KILN_BSDF_PHONG) {
        const float n = l.p.exponent, cosine = i.z * o.z - i.x * o.x - i.y * o.y;
        const float lobe = cosine > 0.0f ? float_pow(cosine, n) * 0.5f * KILN_INVERSE_PI : 0.0f;
        s.value = vec3_scale(l.p.specular_color, lobe * (n + 2.0f) * i.z);
        s.density = lobe * (n + 1.0f);
        return s;
    }
    const KILN_VECTOR h = kiln_direction_of(vec3_add(o, i));
    const float cosine = vec3_dot(o, h), facets = kiln_beckmann(h, l.alpha_x);
    const KILN_STRUCT kiln_bsdf_split split = kiln_bsdf_split_at(l, true, cosine);
    s.value = vec3_scale(split.reflected, facets * kiln_grooves(o, i, h) / (4.0f * o.z));
    s.density = facets * h.z / (4.0f * float_max(cosine, KILN_FLOAT_TINY));
    return s;
}

/* The diffuse surface's part of the value, for directions on one side. */
KILN_FUNCTION KILN_VECTOR kiln_bsdf_diffuse(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR o, KILN_VECTOR i)
{
    const float out_ = kiln_diffuse_out(l, o), in_ = kiln_diffuse_in(l, i);
    return vec3_scale(kiln_diffuse_color(l), in_ * out_ * float_abs(i.z) * KILN_INVERSE_PI);
}

/* Evaluates value and density of i. `choice`: the probabilities of lobes for o. */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_value kiln_bsdf_evaluate_chosen(KILN_STRUCT kiln_bsdf_lobes l,
                                                                    KILN_STRUCT kiln_bsdf_choice choice, KILN_VECTOR o,
                                                                    KILN_VECTOR i, KILN_U32 mode, KILN_U32 lobes)
{
    KILN_STRUCT kiln_bsdf_value s;
    s.value = vec3(0.0f, 0.0f, 0.0f);
    s.density = 0.0f;
    if (o.z == 0.0f || i.z == 0.0f)
        return s;
    const bool front = o.z > 0.0f, gloss = (lobes & KILN_LOBE_GLOSS) != 0u;
    const KILN_VECTOR signed_o = o, signed_i = i;
    o.z = float_abs(o.z);
    i.z = front ? i.z : -i.z;
    if (i.z > 0.0f) {
        if (KILN_LOBES_MAY_BE(KILN_LOBE_DIFFUSE) && (lobes & KILN_LOBE_DIFFUSE) != 0u && l.matt > 0.0f)
            s.value = kiln_bsdf_diffuse(l, signed_o, signed_i);
        s.density = choice.diffuse * i.z * KILN_INVERSE_PI;
    }
    const float spread = i.z > 0.0f ? choice.near : choice.far;
    if (spread > 0.0f)
        s.density += spread * kiln_bsdf_spread_density(l.face.alpha, float_abs(i.z));
    KILN_STRUCT kiln_bsdf_value part;
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_COAT) && (lobes & KILN_LOBE_COAT) != 0u && choice.coat > 0.0f &&
        l.coat_is_mirror == 0u && i.z > 0.0f) {
        const KILN_VECTOR h = kiln_direction_of(vec3_add(o, i));
        part = kiln_bsdf_facets(o, i, h, l.p.coat_alpha, l.p.coat_alpha);
        s.value = vec3_madd(s.value, part.value, l.coat.strength * kiln_fresnel(vec3_dot(o, h), KILN_COAT_INDEX));
        s.density += choice.coat * part.density;
    }
    if (!gloss)
        return s;
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_OLDER) && l.p.model != KILN_BSDF_LAYERS) {
        if (i.z > 0.0f) {
            part = kiln_bsdf_older(l, o, i);
            s.value = vec3_add(s.value, part.value);
            s.density += choice.gloss * part.density;
        }
        return s;
    }
    s.value = vec3_add(s.value, kiln_bsdf_given_back(l, front, o, i, mode));
    if (l.base_is_mirror != 0u)
        return s;
    if (i.z > 0.0f)
        part = kiln_bsdf_reflection(l, front, o, i);
    else if (KILN_BSDF_MAY(KILN_BSDF_MAY_ROUGH_GLASS) && l.glass > 0.0f) {
        part = kiln_bsdf_transmission(l, front, o, i, mode);
        part.value = vec3_scale(part.value, kiln_bsdf_crossing(l, front, o, i));
    } else
        return s;
    s.value = vec3_add(s.value, part.value);
    s.density += choice.gloss * part.density;
    return s;
}

KILN_FUNCTION KILN_STRUCT kiln_bsdf_value kiln_bsdf_evaluate(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR o,
                                                             KILN_VECTOR i, KILN_U32 mode, KILN_U32 lobes)
{
    return kiln_bsdf_evaluate_chosen(l, kiln_bsdf_choose(l, o, lobes), o, i, mode, lobes);
}

/* Density with which kiln_bsdf_draw samples i from o, per steradian, without mirrors and smooth glass. The reverse
 * density is kiln_bsdf_density(l, i, o, lobes). */
KILN_FUNCTION float kiln_bsdf_density(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR o, KILN_VECTOR i, KILN_U32 lobes)
{
    return kiln_bsdf_evaluate(l, o, i, KILN_RADIANCE, lobes).density;
}

/* ---- drawing ---- */

struct kiln_bsdf_drawn {
    KILN_VECTOR i;
    KILN_VECTOR weight; /* f(o, i) |i.z| / density; 0: the path ends */
    float density;      /* of i, per steradian; for a delta its probability */
    KILN_U32 lobe;      /* the one drawn from, KILN_LOBE_... */
    bool delta;         /* a mirror or smooth glass: only this direction */
};

/* Samples a cosine-distributed direction, by u and v in (0, 1). */
KILN_FUNCTION KILN_VECTOR kiln_bsdf_cosine(float u, float v)
{
    const float r = float_sqrt(v);
    float sine, cosine;
    kiln_turn(u, KILN_TO(sine), KILN_TO(cosine));
    return vec3(r * cosine, r * sine, float_sqrt(1.0f - v));
}

/* Refracts o through the facet h with the index eta of one colour. Returns the zero vector for total reflection. */
KILN_FUNCTION KILN_VECTOR kiln_bsdf_through(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR o, KILN_VECTOR h, float eta)
{
    if (l.p.thin_wall != 0u) {
        const KILN_VECTOR i = kiln_reflected(o, h);
        return vec3(i.x, i.y, -i.z);
    }
    const float cosine = vec3_dot(o, h), behind = kiln_refracted_cosine(cosine, eta);
    return behind > 0.0f ? kiln_refracted(o, h, 1.0f / eta, cosine, behind) : vec3(0.0f, 0.0f, 0.0f);
}

/* Samples the smooth base; o.z > 0. `pick` in (0, 1) is the random number, rescaled after the choice of the lobe. */
KILN_FUNCTION void kiln_bsdf_draw_mirror(KILN_STRUCT kiln_bsdf_lobes l, bool front, KILN_VECTOR o, float pick,
                                         float gloss, KILN_U32 mode, KILN_INOUT(KILN_STRUCT kiln_bsdf_drawn) d)
{
    const KILN_VECTOR normal = vec3(0.0f, 0.0f, 1.0f), eta = kiln_bsdf_eta(l.p, front);
    const KILN_STRUCT kiln_bsdf_split split = kiln_bsdf_split_at(l, front, o.z);
    KILN_AT(d).delta = true;
    if (!KILN_BSDF_MAY(KILN_BSDF_MAY_GLASS) || pick < split.chance) {
        const float coat = kiln_bsdf_coat_factor(l, front, o);
        KILN_AT(d).i = vec3(-o.x, -o.y, o.z);
        KILN_AT(d).density = gloss * split.chance;
        KILN_AT(d).weight = vec3_scale(split.reflected, coat * coat / KILN_AT(d).density);
        return;
    }
    KILN_VECTOR color = split.through;
    float index = eta.y, share = 1.0f;
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_DISPERSE) && l.disperses != 0u && l.p.thin_wall == 0u) {
        const float third = 3.0f * (pick - split.chance) / (1.0f - split.chance);
        share = KILN_RATIO32(1, 3);
        index = third < 1.0f ? eta.x : third < 2.0f ? eta.y : eta.z;
        color = third < 1.0f   ? vec3(color.x, 0.0f, 0.0f)
                : third < 2.0f ? vec3(0.0f, color.y, 0.0f)
                               : vec3(0.0f, 0.0f, color.z);
    }
    const KILN_VECTOR i = kiln_bsdf_through(l, o, normal, index);
    const float squared = mode == KILN_IMPORTANCE || l.p.thin_wall != 0u ? 1.0f : index * index;
    KILN_AT(d).i = i;
    KILN_AT(d).density = gloss * (1.0f - split.chance) * share;
    KILN_AT(d).weight =
        vec3_scale(color, i.z == 0.0f ? 0.0f : kiln_bsdf_crossing(l, front, o, i) / (KILN_AT(d).density * squared));
}

/* Samples a direction by the facets of the rough base; o.z > 0. Zero vector: none. */
KILN_FUNCTION KILN_VECTOR kiln_bsdf_draw_gloss(KILN_STRUCT kiln_bsdf_lobes l, bool front, KILN_VECTOR o, float pick,
                                               float u, float v)
{
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_OLDER) && l.p.model == KILN_BSDF_PHONG) {
        const float cosine = float_pow(v, 1.0f / (l.p.exponent + 1.0f));
        const float r = float_sqrt(float_max(0.0f, (1.0f - cosine) * (1.0f + cosine)));
        KILN_VECTOR s, t;
        const KILN_VECTOR axis = vec3(-o.x, -o.y, o.z);
        float a, b;
        kiln_turn(u, KILN_TO(a), KILN_TO(b));
        kiln_basis(axis, KILN_TO(s), KILN_TO(t));
        return vec3_madd(vec3_madd(vec3_scale(axis, cosine), s, r * b), t, r * a);
    }
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_OLDER) && l.p.model == KILN_BSDF_COOK_TORRANCE)
        return kiln_reflected(o, kiln_beckmann_sample(l.alpha_x, u, v));
    const KILN_VECTOR h = kiln_ggx_sample(o, l.alpha_x, l.alpha_y, u, v), eta = kiln_bsdf_eta(l.p, front);
    const float chance = kiln_bsdf_split_at(l, front, vec3_dot(o, h)).chance;
    KILN_VECTOR i = kiln_reflected(o, h);
    if (!KILN_BSDF_MAY(KILN_BSDF_MAY_ROUGH_GLASS) || pick < chance) /* without glass the chance is 1 */
        return i.z > 0.0f ? i : vec3(0.0f, 0.0f, 0.0f);
    float index = eta.y;
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_DISPERSE) && l.disperses != 0u) {
        const float third = 3.0f * (pick - chance) / (1.0f - chance);
        index = third < 1.0f ? eta.x : third < 2.0f ? eta.y : eta.z;
    }
    i = kiln_bsdf_through(l, o, h, index);
    return i.z < 0.0f ? i : vec3(0.0f, 0.0f, 0.0f);
}

/* Samples a direction as kiln_bsdf_draw does; gives weight and density for deltas only. For kernels that contain
 * kiln_bsdf_evaluate only once, since its code is long. `c`: kiln_bsdf_choose of o. */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_drawn kiln_bsdf_propose(KILN_STRUCT kiln_bsdf_lobes l,
                                                            KILN_STRUCT kiln_bsdf_choice c, KILN_VECTOR o, float pick,
                                                            float u, float v, KILN_U32 mode)
{
    KILN_STRUCT kiln_bsdf_drawn d;
    const bool front = o.z > 0.0f;
    const KILN_VECTOR up = vec3(o.x, o.y, float_abs(o.z));
    d.i = vec3(0.0f, 0.0f, 0.0f);
    d.weight = d.i;
    d.density = 0.0f;
    d.lobe = KILN_LOBE_GLOSS;
    d.delta = false;
    if (o.z == 0.0f || c.coat + c.gloss + c.diffuse + c.near + c.far == 0.0f)
        return d;
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_COAT) && pick < c.coat) {
        d.lobe = KILN_LOBE_COAT;
        d.delta = l.coat_is_mirror != 0u;
        if (d.delta) {
            d.i = vec3(-up.x, -up.y, up.z);
            d.weight = kiln_bsdf_gray(kiln_coat_albedo(l.coat, up.z) / c.coat);
            d.density = c.coat;
        } else
            d.i = kiln_reflected(up, kiln_ggx_sample(up, l.p.coat_alpha, l.p.coat_alpha, u, v));
        if (d.i.z < 0.0f)
            d.i = vec3(0.0f, 0.0f, 0.0f);
    } else if (pick < c.coat + c.gloss) {
        const float left = (pick - c.coat) / c.gloss;
        if (KILN_BSDF_MAY(KILN_BSDF_MAY_MIRROR) && l.base_is_mirror != 0u && l.p.model == KILN_BSDF_LAYERS)
            kiln_bsdf_draw_mirror(l, front, up, left, c.gloss, mode, KILN_TO(d));
        else
            d.i = kiln_bsdf_draw_gloss(l, front, up, left, u, v);
    } else if (pick < c.coat + c.gloss + c.diffuse || c.near + c.far == 0.0f) {
        d.lobe = KILN_LOBE_DIFFUSE;
        d.i = kiln_bsdf_cosine(u, v);
    } else {
        d.i = kiln_bsdf_spread_draw(l.face.alpha, u, v);
        if (pick >= c.coat + c.gloss + c.diffuse + c.near && c.far > 0.0f)
            d.i.z = -d.i.z;
    }
    if (!front)
        d.i.z = -d.i.z;
    if (d.i.z == 0.0f) {
        d.weight = vec3(0.0f, 0.0f, 0.0f);
        d.density = 0.0f;
    }
    return d;
}

/* Samples the next direction of a path that comes from o; pick, u and v are random numbers in (0, 1). */
KILN_FUNCTION KILN_STRUCT kiln_bsdf_drawn kiln_bsdf_draw(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR o, float pick,
                                                         float u, float v, KILN_U32 mode, KILN_U32 lobes)
{
    const KILN_STRUCT kiln_bsdf_choice c = kiln_bsdf_choose(l, o, lobes);
    KILN_STRUCT kiln_bsdf_drawn d = kiln_bsdf_propose(l, c, o, pick, u, v, mode);
    if (d.delta || d.i.z == 0.0f)
        return d;
    const KILN_STRUCT kiln_bsdf_value s = kiln_bsdf_evaluate_chosen(l, c, o, d.i, mode, lobes);
    d.density = s.density;
    d.weight = s.density > 0.0f ? vec3_scale(s.value, 1.0f / s.density) : vec3(0.0f, 0.0f, 0.0f);
    return d;
}

/* Density with which kiln_bsdf_draw would sample the reverse of a drawn direction: a path comes from d.i, and goes on
 * to o. Per steradian; for a delta (a mirror or smooth glass) it is the probability. */
KILN_FUNCTION float kiln_bsdf_reverse(KILN_STRUCT kiln_bsdf_lobes l, KILN_VECTOR o, KILN_STRUCT kiln_bsdf_drawn d,
                                      KILN_U32 lobes)
{
    if (!d.delta)
        return kiln_bsdf_density(l, d.i, o, lobes);
    const KILN_STRUCT kiln_bsdf_choice c = kiln_bsdf_choose(l, d.i, lobes);
    if (d.lobe == KILN_LOBE_COAT)
        return c.coat;
    const float chance = kiln_bsdf_split_at(l, d.i.z > 0.0f, float_abs(d.i.z)).chance;
    if (o.z * d.i.z > 0.0f)
        return c.gloss * chance;
    return c.gloss * (1.0f - chance) * (l.disperses != 0u && l.p.thin_wall == 0u ? KILN_RATIO32(1, 3) : 1.0f);
}

/* ---- shading normals ---- */

/* Tells whether a direction is on the same side of the shading and the geometric normal; otherwise nothing is scattered
 * (Veach 1997, section 5.3.3). `normal` is the geometric normal of the front, in the frame of the shading normal. */
KILN_FUNCTION bool kiln_shading_agrees(KILN_VECTOR w, KILN_VECTOR normal) { return w.z * vec3_dot(w, normal) > 0.0f; }

/* Factor on values of importance, for shading normals (Veach 1997, equation 5.19). */
KILN_FUNCTION float kiln_shading_correction(KILN_VECTOR o, KILN_VECTOR i, KILN_VECTOR normal)
{
    return float_abs(o.z * vec3_dot(i, normal)) / float_max(float_abs(vec3_dot(o, normal) * i.z), KILN_FLOAT_TINY);
}

#endif
