/* Gloss of materials: default values, kinds of materials as shown to the user, and the choice of materials whose gloss
 * light transport simulates. Pure functions, thread-safe. */
#ifndef KILN_WORKER_SCENE_GLOSS_H
#define KILN_WORKER_SCENE_GLOSS_H

#include <stdbool.h>

#include "worker/scene/scene.h"

/* Gloss of a material that has no struct kiln_gloss: glTF's defaults (a dielectric of index 1.5) with the material's
 * own metallic, roughness and transmission. `index` is the material's index. */
struct kiln_gloss kiln_gloss_default(const struct kiln_material *material, uint32_t index);

/* The gloss that the scene file has for a material; NULL: none. */
const struct kiln_gloss *kiln_gloss_find(const struct kiln_scene *scene, uint32_t material);

/* Returns the fault of an invalid gloss, as the end of a sentence: a wrong index of material or texture, a number
 * outside its range (struct kiln_gloss), an unknown model, flag or channel. NULL: valid. */
const char *kiln_gloss_fault(const struct kiln_gloss *gloss, size_t material_count, size_t texture_count);

/* The roughness whose GGX lobe is about as wide as a Phong lobe of that exponent: alpha^2 = 2 / (exponent + 2), and
 * roughness^2 = alpha (Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007, section
 * 5.2, for Beckmann's distribution). 0..1. */
float kiln_gloss_phong_roughness(float exponent);

/* Index of refraction; where the material reflects all light (struct kiln_gloss), a large one. */
static inline float kiln_gloss_ior(const struct kiln_gloss *gloss) { return gloss->ior > 0.0f ? gloss->ior : 1.0e4f; }

/* Whether the material is a mirror or smooth glass, with a single direction of reflection or refraction. Places that
 * are so only by a texture do not count. */
bool kiln_gloss_has_mirror(const struct kiln_gloss *gloss);

/* Choice of materials whose gloss light transport simulates. */
enum kiln_gloss_mode {
    KILN_GLOSS_MODE_AUTO,    /* metal, transmission, clear coat, or reflection of roughness < 0.5 */
    KILN_GLOSS_MODE_DIFFUSE, /* none */
    KILN_GLOSS_MODE_FULL     /* all */
};
#define KILN_GLOSS_ROUGHNESS_AUTO 0.5f    /* the mean over a texture counts */
#define KILN_GLOSS_ROUGHNESS_SMOOTH 0.05f /* below it the blur of a thin wall is invisible */
/* Whether `mode` chooses this material. `gloss`: its gloss; NULL: none. */
bool kiln_gloss_needed(const struct kiln_material *material, const struct kiln_gloss *gloss, enum kiln_gloss_mode mode);

/* Whether the material is a thin smooth wall, which light passes straight as in struct kiln_passage, in any mode. */
bool kiln_gloss_is_passage(const struct kiln_gloss *gloss);

/* Chooses the materials taken with their gloss, by `mode`, and sets scene->taken and scene->panes. Call it before a
 * geometry is made of the scene. The scene gets its own copies of materials, in which glass that scatters light no
 * longer lets it pass straight (struct kiln_passage). Thin smooth walls are not taken; they are panes, which transmit
 * the light that they do not reflect. If no material is taken, the materials stay as they are. Not collective.
 * KILN_SYSTEM. */
int kiln_scene_take_gloss(struct kiln_scene *scene, enum kiln_gloss_mode mode, struct kiln_error *error);
/* The gloss that a material is taken with; NULL: it is diffuse. */
static inline const struct kiln_gloss *kiln_gloss_taken(const struct kiln_scene *scene, uint32_t material)
{
    if (scene->taken == NULL || scene->taken[material].material == KILN_NONE)
        return NULL;
    return &scene->taken[material];
}

/* Kinds of materials as shown to the user. A material's kind is the last one in this list that fits. */
enum kiln_gloss_kind {
    KILN_GLOSS_KIND_DIFFUSE,    /* none of the kinds below: not chosen by KILN_GLOSS_MODE_AUTO */
    KILN_GLOSS_KIND_GLOSS,      /* a reflection that is not diffuse */
    KILN_GLOSS_KIND_METAL,      /* metallic above 0 */
    KILN_GLOSS_KIND_CLEAR_COAT, /* a clear coat on whatever lies below */
    KILN_GLOSS_KIND_THIN_GLASS, /* transmission without a body */
    KILN_GLOSS_KIND_VOLUME_GLASS,
    KILN_GLOSS_KINDS
};
enum kiln_gloss_kind kiln_gloss_kind(const struct kiln_material *material, const struct kiln_gloss *gloss);
/* "diffuse", "gloss", "metal", "clear coat", "thin glass", "volume glass". */
const char *kiln_gloss_kind_name(enum kiln_gloss_kind kind);

#endif
