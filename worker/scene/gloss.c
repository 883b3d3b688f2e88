#include "worker/scene/gloss.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

#include "shaders/shared/microfacet_albedo.h"
#include "worker/base/memory.h"

struct kiln_gloss kiln_gloss_default(const struct kiln_material *material, uint32_t index)
{
    struct kiln_gloss gloss = {.material = index,
                               .model = KILN_GLOSS_METALLIC_ROUGHNESS,
                               .metallic = material->metallic,
                               .roughness = material->roughness,
                               .mean_metallic = material->metallic,
                               .mean_roughness = material->roughness,
                               .ior = 1.5f,
                               .specular = 1.0f,
                               .specular_color = {1.0f, 1.0f, 1.0f},
                               .transmission = material->transmission,
                               .filter = {1.0f, 1.0f, 1.0f},
                               .attenuation_color = {1.0f, 1.0f, 1.0f},
                               .clearcoat_normal_scale = 1.0f};
    for (int i = 0; i < KILN_GLOSS_USES; i++)
        gloss.textures[i] =
            (struct kiln_gloss_texture){.texture = KILN_NONE, .transform = {1.0f, 0.0f, 0.0f, 0.0f, 1.0f, 0.0f}};
    return gloss;
}

static int compare_materials(const void *key, const void *element)
{
    const uint32_t wanted = *(const uint32_t *)key, there = ((const struct kiln_gloss *)element)->material;
    return (wanted > there) - (wanted < there);
}

const struct kiln_gloss *kiln_gloss_find(const struct kiln_scene *scene, uint32_t material)
{
    if (scene->gloss_count == 0)
        return NULL;
    return bsearch(&material, scene->glosses, scene->gloss_count, sizeof *scene->glosses, compare_materials);
}

/* ---- checks ---- */

static bool within(const float *values, size_t count, float low, float high)
{
    for (size_t i = 0; i < count; i++)
        if (!(values[i] >= low && values[i] <= high))
            return false;
    return true;
}

static const char *texture_fault(const struct kiln_gloss_texture *use, size_t texture_count)
{
    if (use->texture != KILN_NONE && use->texture >= texture_count)
        return "refers to a texture that does not exist";
    if (use->channel > 3)
        return "reads a channel that no texture has";
    for (int i = 0; i < 6; i++)
        if (!isfinite(use->transform[i]))
            return "has a texture transform that is not a number";
    return NULL;
}

const char *kiln_gloss_fault(const struct kiln_gloss *g, size_t material_count, size_t texture_count)
{
    const float shares[] = {g->metallic,     g->roughness, g->mean_metallic,       g->mean_roughness, g->specular,
                            g->transmission, g->clearcoat, g->clearcoat_roughness, g->anisotropy};
    const float lengths[] = {g->thickness, g->attenuation_distance, g->dispersion, g->exponent};
    if (g->material >= material_count)
        return "refers to a material that does not exist";
    if (g->model > KILN_GLOSS_PHONG || g->flags > (KILN_GLOSS_VOLUME | KILN_GLOSS_MIRROR | KILN_GLOSS_ALPHA_TRANSMITS))
        return "has an unknown model or flag";
    if (!within(shares, sizeof shares / sizeof shares[0], 0.0f, 1.0f) || !within(g->filter, 3, 0.0f, 1.0f) ||
        !within(g->attenuation_color, 3, 0.0f, 1.0f))
        return "has a number outside 0 to 1 where a share belongs";
    if (!within(lengths, sizeof lengths / sizeof lengths[0], 0.0f, HUGE_VALF) ||
        !within(g->specular_color, 3, 0.0f, HUGE_VALF) || !isfinite(g->specular_color[0]) ||
        !isfinite(g->specular_color[1]) || !isfinite(g->specular_color[2]) || !isfinite(g->thickness) ||
        !isfinite(g->attenuation_distance) || !isfinite(g->dispersion) || !isfinite(g->exponent))
        return "has a number below 0 or without an end";
    if (!isfinite(g->ior) || (g->ior != 0.0f && !(g->ior >= 1.0f)))
        return "has an index of refraction below 1";
    if (!isfinite(g->clearcoat_normal_scale) || !isfinite(g->anisotropy_rotation))
        return "has a scale or an angle that is not a number";
    for (int i = 0; i < KILN_GLOSS_USES; i++) {
        const char *fault = texture_fault(&g->textures[i], texture_count);
        if (fault != NULL)
            return fault;
    }
    return NULL;
}

/* ---- what a material is ---- */

float kiln_gloss_phong_roughness(float exponent) { return sqrtf(sqrtf(2.0f / (fmaxf(exponent, 0.0f) + 2.0f))); }

/* Whether the lobe above the diffuse part has any reflection. */
static bool reflects(const struct kiln_gloss *gloss)
{
    const float brightest = fmaxf(gloss->specular_color[0], fmaxf(gloss->specular_color[1], gloss->specular_color[2]));
    return gloss->model == KILN_GLOSS_PHONG ? brightest > 0.0f : gloss->specular > 0.0f;
}

enum kiln_gloss_kind kiln_gloss_kind(const struct kiln_material *material, const struct kiln_gloss *gloss)
{
    if (gloss == NULL) {
        const struct kiln_gloss plain = kiln_gloss_default(material, 0);
        return kiln_gloss_kind(material, &plain);
    }
    if (gloss->transmission > 0.0f && gloss->mean_metallic < 1.0f)
        return (gloss->flags & KILN_GLOSS_VOLUME) != 0 ? KILN_GLOSS_KIND_VOLUME_GLASS : KILN_GLOSS_KIND_THIN_GLASS;
    if (gloss->clearcoat > 0.0f)
        return KILN_GLOSS_KIND_CLEAR_COAT;
    if (gloss->mean_metallic > 0.0f)
        return KILN_GLOSS_KIND_METAL;
    return reflects(gloss) && gloss->mean_roughness < KILN_GLOSS_ROUGHNESS_AUTO ? KILN_GLOSS_KIND_GLOSS
                                                                                : KILN_GLOSS_KIND_DIFFUSE;
}

bool kiln_gloss_needed(const struct kiln_material *material, const struct kiln_gloss *gloss, enum kiln_gloss_mode mode)
{
    if (mode == KILN_GLOSS_MODE_AUTO)
        return kiln_gloss_kind(material, gloss) != KILN_GLOSS_KIND_DIFFUSE;
    return mode == KILN_GLOSS_MODE_FULL;
}

const char *kiln_gloss_kind_name(enum kiln_gloss_kind kind)
{
    static const char *const names[] = {"diffuse", "gloss", "metal", "clear coat", "thin glass", "volume glass"};
    _Static_assert(sizeof names / sizeof names[0] == KILN_GLOSS_KINDS, "a name for each kind");
    assert((unsigned)kind < KILN_GLOSS_KINDS);
    return names[kind];
}

/* ---- what light transport uses ---- */

bool kiln_gloss_is_passage(const struct kiln_gloss *gloss)
{
    return gloss->transmission > 0.0f && (gloss->flags & KILN_GLOSS_VOLUME) == 0 &&
           gloss->mean_roughness < KILN_GLOSS_ROUGHNESS_SMOOTH;
}

/* Returns the reflection of a thin smooth wall, without its textures. eta 0: there is none, or light passes by alpha.
 */
static struct kiln_pane pane_of(const struct kiln_material *material, const struct kiln_gloss *gloss)
{
    const bool phong = gloss->model == KILN_GLOSS_PHONG;
    const struct kiln_pane pane = {
        .eta = kiln_gloss_ior(gloss),
        .specular = phong ? 1.0f : gloss->specular,
        .color =
            phong ? 1.0f : fmaxf(gloss->specular_color[0], fmaxf(gloss->specular_color[1], gloss->specular_color[2])),
        .coat = gloss->clearcoat};
    const bool reflects = (pane.eta > 1.0f && pane.specular > 0.0f) || pane.coat > 0.0f;
    return material->transmission > 0.0f && reflects ? pane : (struct kiln_pane){0};
}

/* Records a material without gloss in light transport that may still be a pane. */
static int take_pane(struct kiln_scene *scene, uint32_t index, struct kiln_error *error)
{
    const struct kiln_gloss *gloss = &scene->taken[index];
    const struct kiln_pane pane =
        kiln_gloss_is_passage(gloss) ? pane_of(&scene->own_materials[index], gloss) : (struct kiln_pane){0};
    if (pane.eta == 0.0f)
        return KILN_OK;
    const int status = scene->panes != NULL ? KILN_OK
                                            : kiln_allocate(&scene->panes, scene->material_count, sizeof *scene->panes,
                                                            "the scene's panes", error);
    if (status == KILN_OK)
        scene->panes[index] = pane;
    return status;
}

int kiln_scene_take_gloss(struct kiln_scene *scene, enum kiln_gloss_mode mode, struct kiln_error *error)
{
    const size_t count = scene->material_count;
    bool any = false;
    if (mode == KILN_GLOSS_MODE_DIFFUSE)
        return KILN_OK;
    int status = kiln_allocate(&scene->taken, count, sizeof *scene->taken, "the scene's gloss", error);
    if (status == KILN_OK)
        status = kiln_allocate(&scene->own_materials, count, sizeof *scene->own_materials, "the materials", error);
    if (status != KILN_OK) {
        kiln_free(&scene->taken);
        return status;
    }
    for (uint32_t i = 0; i < count && status == KILN_OK; i++) {
        struct kiln_material *material = &scene->own_materials[i];
        const struct kiln_gloss *own = kiln_gloss_find(scene, i);
        *material = scene->materials[i];
        scene->taken[i] = own != NULL ? *own : kiln_gloss_default(material, i);
        if (!kiln_gloss_needed(material, own, mode) || kiln_gloss_is_passage(&scene->taken[i])) {
            status = take_pane(scene, i, error);
            scene->taken[i].material = KILN_NONE;
            continue;
        }
        any = true;
        material->transmission = 0.0f;
        if ((scene->taken[i].flags & KILN_GLOSS_ALPHA_TRANSMITS) != 0)
            material->base_color[3] = 1.0f;
    }
    if (any && status == KILN_OK) {
        scene->materials = scene->own_materials;
        return KILN_OK;
    }
    kiln_free(&scene->taken);
    kiln_free(&scene->own_materials);
    return status;
}

bool kiln_gloss_has_mirror(const struct kiln_gloss *gloss)
{
    const float alpha = gloss->roughness * gloss->roughness,
                coat = gloss->clearcoat_roughness * gloss->clearcoat_roughness;
    return (gloss->flags & KILN_GLOSS_MIRROR) != 0 || alpha < KILN_MIRROR_ALPHA ||
           (gloss->clearcoat > 0.0f && coat < KILN_MIRROR_ALPHA);
}
