/* Scattering of surfaces that are not only diffuse: reads their textures at a position, for shaders/shared/gloss.h, and
 * the data that the host has prepared.
 *
 * For world triangles; (u, v) are barycentrics, as tracing returns them. */
#ifndef KILN_SHADERS_GLOSS_GLSL
#define KILN_SHADERS_GLOSS_GLSL

#include "shaders/material.glsl"
#include "shaders/shared/gloss.h"

KILN_ARRAY(GlossArray, kiln_gpu_gloss, 4);
KILN_ARRAY(GlossPlaces, kiln_gpu_gloss_place, 4);

/* Flags of a material's gloss (KILN_GPU_GLOSS_...); 0: it is diffuse. `material` is an index into the scene's. */
uint kiln_gloss_flags(uint material) { return GlossArray(SCENE.materials.glosses).at[material].flags; }

/* Reads the texture for each use at texture coordinates. A use with a single number has it in x. */
void kiln_gloss_texels(uint material, uint flags, vec2 at, out vec4 texels[KILN_GPU_GLOSS_USES])
{
    for (uint use = 0u; use < KILN_GPU_GLOSS_USES; use++) {
        texels[use] = vec4(1.0);
        if ((flags & KILN_GPU_GLOSS_TEXTURED) == 0u)
            continue;
        const kiln_gpu_gloss_texture t = GlossArray(SCENE.materials.glosses).at[material].textures[use];
        if (t.texture == KILN_GPU_NONE)
            continue;
        const vec4 texel =
            kiln_texture_sample(t.texture, vec2(t.transform[0] * at.x + t.transform[1] * at.y + t.transform[2],
                                                t.transform[3] * at.x + t.transform[4] * at.y + t.transform[5]));
        const bool color = use == KILN_GPU_GLOSS_SPECULAR_COLOR || use == KILN_GPU_GLOSS_ANISOTROPY;
        texels[use] = color ? texel : vec4(texel[t.channel]);
    }
}

/* Strength of anisotropy; `turn`: cosine and sine of the tangent's direction, from the u axis on. */
float kiln_gloss_anisotropy(kiln_gpu_gloss g, vec4 texel, out vec2 turn)
{
    turn = vec2(g.turn_cosine, g.turn_sine);
    if (g.textures[KILN_GPU_GLOSS_ANISOTROPY].texture == KILN_GPU_NONE)
        return g.anisotropy;
    kiln_gloss_turn(texel.r, texel.g, turn.x, turn.y);
    return g.anisotropy * texel.b;
}

kiln_bsdf kiln_gloss_bsdf(kiln_gpu_gloss g, vec3 base_color, vec4 texels[KILN_GPU_GLOSS_USES], float anisotropy)
{
    kiln_gloss_values v;
    v.base_color = base_color;
    v.specular_color =
        vec3(g.specular_color[0], g.specular_color[1], g.specular_color[2]) * texels[KILN_GPU_GLOSS_SPECULAR_COLOR].rgb;
    v.filter_color = vec3(g.filter_color[0], g.filter_color[1], g.filter_color[2]);
    v.eta = vec3(g.eta[0], g.eta[1], g.eta[2]);
    v.metallic = g.metallic * texels[KILN_GPU_GLOSS_METALLIC].x;
    v.roughness = g.roughness * texels[KILN_GPU_GLOSS_ROUGHNESS].x;
    v.specular = g.specular * texels[KILN_GPU_GLOSS_SPECULAR].x;
    v.transmission = g.transmission * texels[KILN_GPU_GLOSS_TRANSMISSION].x;
    v.coat = g.coat * texels[KILN_GPU_GLOSS_COAT].x;
    v.coat_roughness = g.coat_roughness * texels[KILN_GPU_GLOSS_COAT_ROUGHNESS].x;
    v.anisotropy = anisotropy;
    v.exponent = g.exponent * texels[KILN_GPU_GLOSS_ROUGHNESS].x;
    v.thin_wall = (g.flags & KILN_GPU_GLOSS_VOLUME) == 0u;
    v.phong = (g.flags & KILN_GPU_GLOSS_PHONG) != 0u;
    v.mirror = (g.flags & KILN_GPU_GLOSS_MIRROR) != 0u;
    return kiln_gloss_scattering(v);
}

mat3 kiln_frame_about(vec3 z)
{
    vec3 x, y;
    kiln_basis(z, x, y);
    return mat3(x, y, z);
}

/* See kiln_gloss_axes; corners are in stored order. */
mat3 kiln_gloss_frame(vec3 z, float place[6], vec3 edge1, vec3 edge2, vec2 turn)
{
    const vec2 a = vec2(place[0], place[1]), b = vec2(place[2], place[3]) - a, c = vec2(place[4], place[5]) - a;
    vec3 x, y;
    if (!kiln_gloss_axes(z, b.x, b.y, c.x, c.y, edge1, edge2, turn.x, turn.y, x, y))
        return kiln_frame_about(z);
    return mat3(x, y, z);
}

KILN_ARRAY(LobesArray, kiln_bsdf_lobes, 4);

/* Returns the scattering at a position of a world triangle whose material has gloss. Directions are given in a frame
 * (columns of a matrix) whose z is the shading normal of the front. Edges lead from the world triangle's corner 0 to 1
 * and to 2. The host has prepared values that are constant over a material. */
kiln_bsdf_lobes kiln_surface_lobes(uint material, uint triangle, float u, float v, vec3 z, vec3 edge1, vec3 edge2,
                                   out mat3 frame)
{
    const kiln_gpu_gloss g = GlossArray(SCENE.materials.glosses).at[material];
    const bool placed = SCENE.materials.gloss_places != 0ul;
    const uint slot = kiln_slot_of(triangle);
    const bool flipped = (slot & KILN_GPU_FLIPPED) != 0u;
    float place[6] = float[6](0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    vec4 texels[KILN_GPU_GLOSS_USES];
    vec2 turn;
    float anisotropy = 0.0;
    if (HAS_VARIED != 0u || KILN_BSDF_MAY(KILN_BSDF_MAY_ACROSS)) {
        if (placed)
            place = GlossPlaces(SCENE.materials.gloss_places + 24ul * (slot & ~KILN_GPU_FLIPPED)).at[0].at;
        kiln_gloss_texels(material, HAS_VARIED != 0u ? g.flags : 0u,
                          kiln_interpolated(place, flipped ? v : u, flipped ? u : v), texels);
        anisotropy = kiln_gloss_anisotropy(g, texels[KILN_GPU_GLOSS_ANISOTROPY], turn);
    }
    if (KILN_BSDF_MAY(KILN_BSDF_MAY_ACROSS) && placed && g.anisotropy > 0.0)
        frame = kiln_gloss_frame(z, place, flipped ? edge2 : edge1, flipped ? edge1 : edge2, turn);
    else
        frame = kiln_frame_about(z);
    const vec3 color = kiln_surface_color(triangle, u, v, true);
    if (HAS_VARIED != 0u && (g.flags & KILN_GPU_GLOSS_PREPARED) == 0u)
        return kiln_bsdf_prepare_hit(kiln_gloss_bsdf(g, color, texels, anisotropy),
                                     kiln_bsdf_tables(g.brushed[0], g.brushed[1], g.trapped[0], g.trapped[1]));
    kiln_bsdf_lobes lobes = LobesArray(SCENE.materials.lobes).at[material];
    if ((g.flags & KILN_GPU_GLOSS_DYED) != 0u)
        kiln_bsdf_dye(lobes, color);
    return lobes;
}

/* The frame at the position, about another normal. */
mat3 kiln_surface_frame(uint material, uint triangle, float u, float v, vec3 z, vec3 edge1, vec3 edge2)
{
    const kiln_gpu_gloss g = GlossArray(SCENE.materials.glosses).at[material];
    if (!KILN_BSDF_MAY(KILN_BSDF_MAY_ACROSS) || SCENE.materials.gloss_places == 0ul || !(g.anisotropy > 0.0))
        return kiln_frame_about(z);
    const uint slot = kiln_slot_of(triangle);
    const bool flipped = (slot & KILN_GPU_FLIPPED) != 0u;
    const float place[6] = GlossPlaces(SCENE.materials.gloss_places + 24ul * (slot & ~KILN_GPU_FLIPPED)).at[0].at;
    vec4 texels[KILN_GPU_GLOSS_USES];
    vec2 turn;
    kiln_gloss_texels(material, HAS_VARIED != 0u ? g.flags : 0u,
                      kiln_interpolated(place, flipped ? v : u, flipped ? u : v), texels);
    kiln_gloss_anisotropy(g, texels[KILN_GPU_GLOSS_ANISOTROPY], turn);
    return kiln_gloss_frame(z, place, flipped ? edge2 : edge1, flipped ? edge1 : edge2, turn);
}

/* Share of light, by colour, that is left after `distance` m in the body of the material. */
vec3 kiln_gloss_attenuation(uint material, float distance)
{
    const kiln_gpu_gloss g = GlossArray(SCENE.materials.glosses).at[material];
    return vec3(kiln_gloss_left(g.attenuation_color[0], g.attenuation_distance, distance),
                kiln_gloss_left(g.attenuation_color[1], g.attenuation_distance, distance),
                kiln_gloss_left(g.attenuation_color[2], g.attenuation_distance, distance));
}

#endif
