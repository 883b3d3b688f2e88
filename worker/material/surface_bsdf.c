#include "worker/material/surface_bsdf.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/gloss.h"
#include "worker/scene/texture.h"

/* A position of a gloss's surface. */
struct spot {
    const struct kiln_scene *scene;
    const struct kiln_gloss *gloss;
    struct kiln_vec2 at; /* texcoord_gloss */
};

static struct spot spot_at(const struct kiln_scene *scene, const struct kiln_gloss *gloss, const struct kiln_mesh *mesh,
                           uint64_t triangle, float b1, float b2)
{
    struct spot s = {scene, gloss, {0.0f, 0.0f}};
    if (scene->texcoord_gloss == NULL)
        return s;
    const struct kiln_vec2 *uv = scene->texcoord_gloss + mesh->vertex_first;
    const uint32_t *corner = scene->triangles + 3 * triangle;
    const struct kiln_vec2 a = uv[corner[0]], b = uv[corner[1]], c = uv[corner[2]];
    s.at.x = a.x + b1 * (b.x - a.x) + b2 * (c.x - a.x);
    s.at.y = a.y + b1 * (b.y - a.y) + b2 * (c.y - a.y);
    return s;
}

/* Reads the texture for a use, as linear RGBA; false, and ones, if there is none. */
static bool texel_of(const struct spot *s, enum kiln_gloss_use use, float rgba[4])
{
    const struct kiln_gloss_texture *t = &s->gloss->textures[use];
    for (int c = 0; c < 4; c++)
        rgba[c] = 1.0f;
    if (t->texture == KILN_NONE)
        return false;
    kiln_texture_sample(s->scene, t->texture, t->transform[0] * s->at.x + t->transform[1] * s->at.y + t->transform[2],
                        t->transform[3] * s->at.x + t->transform[4] * s->at.y + t->transform[5], rgba);
    return true;
}

static float number_of(const struct spot *s, enum kiln_gloss_use use)
{
    float rgba[4];
    texel_of(s, use, rgba);
    return rgba[s->gloss->textures[use].channel];
}

/* Strength of anisotropy, and cosine and sine of the tangent's angle from the u axis. */
static float anisotropy_of(const struct spot *s, float *cosine, float *sine)
{
    float rgba[4];
    *cosine = cosf(s->gloss->anisotropy_rotation);
    *sine = sinf(s->gloss->anisotropy_rotation);
    if (!texel_of(s, KILN_GLOSS_ANISOTROPY, rgba))
        return s->gloss->anisotropy;
    kiln_gloss_turn(rgba[0], rgba[1], cosine, sine);
    return s->gloss->anisotropy * rgba[2];
}

struct kiln_vec3 kiln_gloss_index(const struct kiln_gloss *gloss)
{
    const float index = kiln_gloss_ior(gloss);
    return gloss->dispersion > 0.0f ? kiln_dispersed_index(index, gloss->dispersion) : vec3(index, index, index);
}

static struct kiln_bsdf bsdf_at(const struct spot *s, const float base[3])
{
    const struct kiln_gloss *g = s->gloss;
    const float *color = g->specular_color, roughness = number_of(s, KILN_GLOSS_ROUGHNESS);
    const bool phong = g->model == KILN_GLOSS_PHONG;
    float tint[4], cosine, sine;
    texel_of(s, KILN_GLOSS_SPECULAR_COLOR, tint);
    const struct kiln_gloss_values values = {
        .base_color = vec3(base[0], base[1], base[2]),
        .specular_color = vec3(color[0] * tint[0], color[1] * tint[1], color[2] * tint[2]),
        .filter_color = vec3(g->filter[0], g->filter[1], g->filter[2]),
        .eta = kiln_gloss_index(g),
        .metallic = g->metallic * number_of(s, KILN_GLOSS_METALLIC),
        .roughness = g->roughness * roughness,
        .specular = g->specular * number_of(s, KILN_GLOSS_SPECULAR),
        .transmission = g->transmission * number_of(s, KILN_GLOSS_TRANSMISSION),
        .coat = g->clearcoat * number_of(s, KILN_GLOSS_CLEARCOAT),
        .coat_roughness = g->clearcoat_roughness * number_of(s, KILN_GLOSS_CLEARCOAT_ROUGHNESS),
        .anisotropy = phong ? 0.0f : anisotropy_of(s, &cosine, &sine),
        .exponent = g->exponent * roughness,
        .thin_wall = (g->flags & KILN_GLOSS_VOLUME) == 0,
        .phong = phong,
        .mirror = (g->flags & KILN_GLOSS_MIRROR) != 0};
    return kiln_gloss_scattering(&values);
}

struct kiln_bsdf kiln_surface_bsdf(const struct kiln_scene *scene, const struct kiln_gloss *gloss,
                                   const struct kiln_mesh *mesh, uint64_t triangle, float b1, float b2)
{
    const struct spot s = spot_at(scene, gloss, mesh, triangle, b1, b2);
    float base[4];
    kiln_surface_base_color(scene, mesh, triangle, b1, b2, base);
    return bsdf_at(&s, base);
}

struct kiln_bsdf kiln_gloss_bsdf(const struct kiln_gloss *gloss, const float base[3])
{
    const struct spot s = {.gloss = gloss};
    return bsdf_at(&s, base);
}

static bool has_textures(const struct kiln_gloss *gloss)
{
    for (int use = 0; use < KILN_GLOSS_USES; use++)
        if (gloss->textures[use].texture != KILN_NONE)
            return true;
    return false;
}

struct kiln_gloss_lobes kiln_gloss_lobes(const struct kiln_scene *scene, uint32_t material)
{
    const struct kiln_gloss *gloss = kiln_gloss_taken(scene, material);
    struct kiln_gloss_lobes of = {.ready = false};
    if (gloss == NULL || has_textures(gloss))
        return of;
    const bool phong = gloss->model == KILN_GLOSS_PHONG, through = gloss->transmission > 0.0f;
    if (phong && !through && (gloss->flags & KILN_GLOSS_MIRROR) != 0)
        return of; /* a metal where it is black */
    of.ready = true;
    of.dyed = !phong || !through;
    of.lobes = kiln_bsdf_prepare(kiln_gloss_bsdf(gloss, scene->materials[material].base_color));
    return of;
}

struct kiln_bsdf_lobes kiln_surface_lobes(const struct kiln_scene *scene, const struct kiln_gloss_lobes *of,
                                          const struct kiln_mesh *mesh, uint64_t triangle, float b1, float b2,
                                          bool colored)
{
    if (!of->ready)
        return kiln_bsdf_prepare_hit(kiln_surface_bsdf(scene,
                                                       kiln_gloss_taken(scene, scene->triangle_materials[triangle]),
                                                       mesh, triangle, b1, b2),
                                     of->tables);
    struct kiln_bsdf_lobes lobes = of->lobes;
    if (of->dyed && (colored || lobes.metal > 0.0f || lobes.glass > 0.0f)) {
        float base[4];
        kiln_surface_base_color(scene, mesh, triangle, b1, b2, base);
        kiln_bsdf_dye(&lobes, vec3(base[0], base[1], base[2]));
    }
    return lobes;
}

void kiln_surface_albedo(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                         float b2, float rgb[3])
{
    const struct kiln_gloss *gloss = kiln_gloss_taken(scene, scene->triangle_materials[triangle]);
    float rgba[4];
    if (gloss == NULL) {
        kiln_surface_color(scene, mesh, triangle, b1, b2, rgba);
        memcpy(rgb, rgba, 3 * sizeof *rgb);
        return;
    }
    const struct kiln_bsdf p = kiln_surface_bsdf(scene, gloss, mesh, triangle, b1, b2);
    const struct kiln_vec3 color = vec3_scale(p.base_color, kiln_bsdf_matt(p));
    rgb[0] = color.x, rgb[1] = color.y, rgb[2] = color.z;
}

/* ---- frames ---- */

struct kiln_frame kiln_frame_about(struct kiln_vec3 z)
{
    struct kiln_frame frame = {.z = z};
    kiln_basis(z, &frame.x, &frame.y);
    return frame;
}

struct kiln_frame kiln_surface_frame(const struct kiln_scene *scene, const struct kiln_gloss *gloss,
                                     const struct kiln_mesh *mesh, uint64_t triangle, float b1, float b2,
                                     struct kiln_vec3 z, const struct kiln_vec3 edge[2])
{
    if (!(gloss->anisotropy > 0.0f) || scene->texcoord_gloss == NULL)
        return kiln_frame_about(z);
    const struct spot s = spot_at(scene, gloss, mesh, triangle, b1, b2);
    const struct kiln_vec2 *uv = scene->texcoord_gloss + mesh->vertex_first;
    const uint32_t *corner = scene->triangles + 3 * triangle;
    const struct kiln_vec2 a = uv[corner[0]], b = uv[corner[1]], c = uv[corner[2]];
    struct kiln_frame frame = {.z = z};
    float cosine, sine;
    (void)anisotropy_of(&s, &cosine, &sine);
    return kiln_gloss_axes(z, b.x - a.x, b.y - a.y, c.x - a.x, c.y - a.y, edge[0], edge[1], cosine, sine, &frame.x,
                           &frame.y)
               ? frame
               : kiln_frame_about(z);
}

void kiln_gloss_attenuation(const struct kiln_gloss *gloss, float distance, float share[3])
{
    for (int c = 0; c < 3; c++)
        share[c] = kiln_gloss_left(gloss->attenuation_color[c], gloss->attenuation_distance, distance);
}
