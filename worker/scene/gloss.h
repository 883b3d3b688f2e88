/* Gloss of materials: what it is where a file says nothing, what kind of material a user sees in it, and which
 * materials light transport treats as more than diffuse. Pure functions, thread-safe. */
#ifndef KILN_WORKER_SCENE_GLOSS_H
#define KILN_WORKER_SCENE_GLOSS_H

#include <stdbool.h>

#include "worker/scene/scene.h"

/* Gloss of a material that has no struct kiln_gloss: glTF's defaults (a dielectric of index 1.5) with the material's
 * own metallic, roughness and transmission. `index` is the material's index. */
struct kiln_gloss kiln_gloss_default(const struct kiln_material *material, uint32_t index);

/* The gloss that the scene file has for a material; NULL: none. */
const struct kiln_gloss *kiln_gloss_find(const struct kiln_scene *scene, uint32_t material);

/* Fault of a gloss, as the end of a sentence: an index without its material or texture, a number outside its range
 * (struct kiln_gloss), an unknown model, flag or channel. NULL: none. */
const char *kiln_gloss_fault(const struct kiln_gloss *gloss, size_t material_count, size_t texture_count);

/* The roughness whose GGX lobe is about as wide as a Phong lobe of that exponent: alpha^2 = 2 / (exponent + 2), and
 * roughness^2 = alpha (Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007, section
 * 5.2, for Beckmann's distribution). 0..1. */
float kiln_gloss_phong_roughness(float exponent);

/* Index of refraction; where the material reflects all light (struct kiln_gloss), a large one. */
static inline float kiln_gloss_ior(const struct kiln_gloss *gloss) { return gloss->ior > 0.0f ? gloss->ior : 1.0e4f; }

/* Whether light comes by a mirror or smooth glass, which send it one way: where a texture says so does not count. */
bool kiln_gloss_has_mirror(const struct kiln_gloss *gloss);

/* Which materials are more than diffuse to light transport. */
enum kiln_gloss_mode {
    KILN_GLOSS_MODE_AUTO,    /* those with metal, transmission, a clear coat, or a reflection of roughness below 0.5 */
    KILN_GLOSS_MODE_DIFFUSE, /* none */
    KILN_GLOSS_MODE_FULL     /* all */
};
#define KILN_GLOSS_ROUGHNESS_AUTO 0.5f    /* the mean over a texture counts */
#define KILN_GLOSS_ROUGHNESS_SMOOTH 0.05f /* below it a thin wall blurs nothing that anyone would see */
/* Whether a material is. `gloss` is its gloss; NULL: it has none. */
bool kiln_gloss_needed(const struct kiln_material *material, const struct kiln_gloss *gloss, enum kiln_gloss_mode mode);

/* Whether light goes straight through, as struct kiln_passage has it, in any mode: by a thin smooth wall. */
bool kiln_gloss_is_passage(const struct kiln_gloss *gloss);

/* Has light transport take the scene's materials as `mode` says: call it before a geometry is made of the scene. Glass
 * that light is sent on by, its own materials' copies do not let through any more (struct kiln_passage); thin smooth
 * walls let light straight through and are not taken, but are panes, which let through what they do not reflect
 * (scene->panes). Where it takes none, the materials stay as they are. Not collective. KILN_SYSTEM. */
int kiln_scene_take_gloss(struct kiln_scene *scene, enum kiln_gloss_mode mode, struct kiln_error *error);
/* The gloss that a material is taken with; NULL: it is diffuse. */
static inline const struct kiln_gloss *kiln_gloss_taken(const struct kiln_scene *scene, uint32_t material)
{
    if (scene->taken == NULL || scene->taken[material].material == KILN_NONE)
        return NULL;
    return &scene->taken[material];
}

/* Kinds of materials as a user sees them: the first of these that fits, from the last on. */
enum kiln_gloss_kind {
    KILN_GLOSS_KIND_DIFFUSE,    /* nothing of what follows: not needed by KILN_GLOSS_MODE_AUTO */
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
