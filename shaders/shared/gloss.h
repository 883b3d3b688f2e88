/* Glossy materials at a point: converts factors times texture values to the input of scattering functions (struct
 * kiln_bsdf), and finds the frame of anisotropic highlights. Texture lookup differs between C and GLSL and is not here
 * (shaders/shared/language.h). */
#ifndef KILN_SHADERS_SHARED_GLOSS_H
#define KILN_SHADERS_SHARED_GLOSS_H

#include "shaders/shared/bsdf.h"
#include "shaders/shared/warp.h"

/* Material values at a point: each factor times its texture's value. */
struct kiln_gloss_values {
    KILN_VECTOR base_color, specular_color, filter_color;
    KILN_VECTOR eta; /* index of refraction for red, green and blue */
    float metallic, roughness, specular, transmission, coat, coat_roughness;
    float anisotropy; /* strength */
    float exponent;
    bool thin_wall, phong, mirror;
};

KILN_FUNCTION KILN_STRUCT kiln_bsdf kiln_gloss_scattering(KILN_IN(KILN_STRUCT kiln_gloss_values) g)
{
    const KILN_VECTOR base = KILN_AT(g).base_color, one = vec3(1.0f, 1.0f, 1.0f);
    KILN_STRUCT kiln_bsdf p;
    p.base_color = base;
    p.specular_color = KILN_AT(g).specular_color;
    p.eta = KILN_AT(g).eta;
    p.transmission = KILN_AT(g).transmission;
    p.thin_wall = KILN_AT(g).thin_wall ? 1u : 0u;
    p.model = KILN_BSDF_LAYERS;
    p.metallic = 0.0f;
    p.specular = 0.0f;
    p.alpha_x = 0.0f;
    p.alpha_y = 0.0f;
    p.coat = 0.0f;
    p.coat_alpha = 0.0f;
    p.exponent = 0.0f;
    if (KILN_AT(g).phong) {
        const bool through = p.transmission > 0.0f, black = base.x == 0.0f && base.y == 0.0f && base.z == 0.0f;
        if (!through && !(KILN_AT(g).mirror && black)) {
            p.model = KILN_BSDF_PHONG;
            p.exponent = KILN_AT(g).mirror ? KILN_BSDF_PHONG_MIRROR : KILN_AT(g).exponent;
            p.alpha_x = kiln_bsdf_phong_alpha(p.exponent);
            p.alpha_y = p.alpha_x;
            return p;
        }
        /* a mirror is a metal of the specular colour */
        p.base_color = through ? KILN_AT(g).filter_color : p.specular_color;
        p.metallic = through ? 0.0f : 1.0f;
        p.specular_color = one;
        p.specular = 1.0f;
        return p;
    }
    p.metallic = KILN_AT(g).metallic;
    p.specular = KILN_AT(g).specular;
    kiln_bsdf_alphas(KILN_AT(g).roughness, KILN_AT(g).anisotropy, KILN_TO(p.alpha_x), KILN_TO(p.alpha_y));
    p.coat = KILN_AT(g).coat;
    p.coat_alpha = KILN_AT(g).coat_roughness * KILN_AT(g).coat_roughness;
    return p;
}

/* Rotates the tangent by an anisotropy texture. On entry (cosine, sine) is the angle of the tangent from the u axis
 * without the texture; red and green are the texture's value. */
KILN_FUNCTION void kiln_gloss_turn(float red, float green, KILN_INOUT(float) cosine, KILN_INOUT(float) sine)
{
    const float x = 2.0f * red - 1.0f, y = 2.0f * green - 1.0f, far = KILN_LENGTH2(x, y), c = KILN_AT(cosine),
                s = KILN_AT(sine);
    if (!(far > 0.0f))
        return;
#ifdef KILN_GLSL
    const float a = x / far, b = y / far;
#else
    const float scale = 1.0f / far, a = x * scale, b = y * scale;
#endif
    KILN_AT(cosine) = c * a - s * b;
    KILN_AT(sine) = s * a + c * b;
}

/* Computes the frame about z of anisotropic highlights, which are stretched along x; x is turned by (cosine, sine) from
 * the direction of increasing u. edge1 and edge2 go from corner 0 to corners 1 and 2; b and c are these edges in
 * texture coordinates. False: they define no direction. */
KILN_FUNCTION bool kiln_gloss_axes(KILN_VECTOR z, float bx, float by, float cx, float cy, KILN_VECTOR edge1,
                                   KILN_VECTOR edge2, float cosine, float sine, KILN_OUT(KILN_VECTOR) x,
                                   KILN_OUT(KILN_VECTOR) y)
{
    const float turned = bx * cy - cx * by < 0.0f ? -1.0f : 1.0f;
    /* how the position changes along u, times the area in the texture */
    const KILN_VECTOR along = vec3_scale(vec3_sub(vec3_scale(edge1, cy), vec3_scale(edge2, by)), turned),
                      tangent = vec3_sub(along, vec3_scale(z, vec3_dot(along, z)));
    const bool is_there = vec3_length(tangent) > 0.0f;
    if (is_there) {
        const KILN_VECTOR t = vec3_normalize(tangent);
        KILN_AT(x) = vec3_madd(vec3_scale(t, cosine), vec3_cross(z, t), sine);
        KILN_AT(y) = vec3_cross(z, KILN_AT(x));
    }
    return is_there;
}

/* Transmittance of one colour over `distance` m in the medium that faces of the material bound (Beer's law). `over`:
 * the distance at which the transmittance is `color`; 0: no absorption. */
KILN_FUNCTION float kiln_gloss_left(float color, float over, float distance)
{
    return over > 0.0f ? float_pow(color, distance / over) : 1.0f;
}

#endif
