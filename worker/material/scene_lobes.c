#include "worker/material/scene_lobes.h"

#include <math.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/material/brushed.h"
#include "worker/scene/texture.h"

/* ---- ranges of numbers that vary by texture ---- */

struct range {
    float least, most;
};

/* Returns the range of a factor times its texture's channel, over all texels. */
static struct range range_of(const struct kiln_scene *scene, float factor, const struct kiln_gloss_texture *t,
                             uint32_t channel)
{
    if (t->texture == KILN_NONE)
        return (struct range){factor, factor};
    const struct kiln_texture *texture = &scene->textures[t->texture];
    const uint8_t *texels = scene->texels + texture->first;
    uint8_t least = 255, most = 0;
    for (size_t k = 0; k < (size_t)texture->width * texture->height; k++) {
        const uint8_t code = texels[4 * k + channel];
        least = code < least ? code : least;
        most = code > most ? code : most;
    }
    float linear[256];
    kiln_texture_codes(linear);
    if (texture->srgb == 0 || channel == 3)
        return (struct range){factor * (float)least / 255.0f, factor * (float)most / 255.0f};
    return (struct range){factor * linear[least], factor * linear[most]};
}

static struct range number_range(const struct kiln_scene *scene, const struct kiln_gloss *gloss, float factor,
                                 enum kiln_gloss_use use)
{
    return range_of(scene, factor, &gloss->textures[use], gloss->textures[use].channel);
}

static bool varies(struct range r) { return r.least != r.most; }

/* ---- which tables a material needs ---- */

enum kind { NO_TABLE, BRUSHED, HELD };

/* A table to be made. Equal plans give equal tables. */
struct plan {
    uint32_t kind;
    struct kiln_bsdf material;
    float anisotropy;
    struct kiln_layers layers, coats;
};

static size_t plan_bytes(const struct plan *p)
{
    return p->kind == BRUSHED ? (size_t)p->layers.count * sizeof(struct kiln_brushed_table)
           : p->kind == HELD  ? sizeof(struct kiln_bsdf_trapped_table)
                              : 0;
}

/* Returns a material with default values for all that tables do not depend on: colours, roughness, and the mix of lobes
 * that no coat covers. */
static struct kiln_bsdf bare_material(const struct kiln_gloss *gloss)
{
    const struct kiln_vec3 white = vec3(1.0f, 1.0f, 1.0f);
    const bool body = (gloss->flags & KILN_GLOSS_VOLUME) != 0;
    return (struct kiln_bsdf){.base_color = white,
                              .specular_color = white,
                              .eta = kiln_gloss_index(gloss),
                              .specular = 1.0f,
                              .transmission = body && gloss->transmission > 0.0f ? 1.0f : 0.0f,
                              .thin_wall = body ? 0u : 1u,
                              .model = KILN_BSDF_LAYERS};
}

/* Layers for roughnesses from r.least to r.most: at least four, for interpolation by polynomials, and one beyond. */
static struct kiln_layers brushed_layers(struct range r)
{
    const float low = kiln_brushed_layer(r.least * r.least), high = kiln_brushed_layer(r.most * r.most);
    if (!varies(r))
        return (struct kiln_layers){low, low, 1};
    const float end = (float)(KILN_BRUSHED_LAYERS - 1);
    const float first = fminf(fmaxf(floorf(low) - 1.0f, 0.0f), end - 3.0f);
    const float last = fmaxf(fminf(ceilf(high) + 1.0f, end), first + 3.0f);
    return (struct kiln_layers){first, last, 1 + (int)(last - first)};
}

/* Plans a table, unless anisotropy or coat strength vary over the surface, or a body hardly refracts light. */
static void plan_brushed(struct plan *p, const struct kiln_scene *scene, const struct kiln_gloss *gloss,
                         struct range roughness, float anisotropy)
{
    const struct range coat = number_range(scene, gloss, gloss->clearcoat, KILN_GLOSS_CLEARCOAT);
    const struct range coat_roughness =
        number_range(scene, gloss, gloss->clearcoat_roughness, KILN_GLOSS_CLEARCOAT_ROUGHNESS);
    if (varies(coat) || (coat.most > 0.0f && varies(coat_roughness)) ||
        (p->material.transmission > 0.0f && gloss->ior > 0.0f && gloss->ior < 1.05f))
        return;
    p->kind = BRUSHED;
    p->anisotropy = anisotropy;
    p->layers = brushed_layers(roughness);
    if (coat.most > 0.0f) { /* the coat's factor is that of the mean base */
        p->material.coat = coat.most;
        p->material.coat_alpha = coat_roughness.most * coat_roughness.most;
        p->material.metallic = gloss->mean_metallic;
        p->material.transmission = gloss->transmission;
    }
}

static void plan_held(struct plan *p, const struct kiln_scene *scene, const struct kiln_gloss *gloss,
                      struct range roughness)
{
    const struct range coat = number_range(scene, gloss, gloss->clearcoat_roughness, KILN_GLOSS_CLEARCOAT_ROUGHNESS);
    if (!(gloss->clearcoat > 0.0f) || !(p->material.transmission > 0.0f) || gloss->mean_metallic == 1.0f)
        return;
    p->kind = HELD;
    p->layers = kiln_layers_of(roughness.least, roughness.most, KILN_BSDF_TRAPPED_LAYERS - 1);
    p->coats = kiln_layers_of(coat.least, coat.most, KILN_BSDF_TRAPPED_COATS - 1);
}

static void plan_of(struct plan *p, const struct kiln_scene *scene, const struct kiln_gloss_lobes *of,
                    uint32_t material)
{
    const struct kiln_gloss *gloss = kiln_gloss_taken(scene, material);
    memset(p, 0, sizeof *p);
    if (of->ready) {
        p->kind = kiln_brushed_wanted(&of->lobes) ? BRUSHED : NO_TABLE;
        p->layers.count = 1;
        return;
    }
    if (gloss == NULL || gloss->model == KILN_GLOSS_PHONG)
        return;
    p->material = bare_material(gloss);
    if (!(gloss->anisotropy > 0.0f) && !(gloss->clearcoat > 0.0f && p->material.transmission > 0.0f))
        return; /* usual case, before textures are searched */
    const struct range roughness = number_range(scene, gloss, gloss->roughness, KILN_GLOSS_ROUGHNESS);
    const struct range anisotropy = range_of(scene, gloss->anisotropy, &gloss->textures[KILN_GLOSS_ANISOTROPY], 2);
    if (varies(anisotropy))
        return;
    if (anisotropy.most > 0.0f)
        plan_brushed(p, scene, gloss, roughness, anisotropy.most);
    else
        plan_held(p, scene, gloss, roughness);
}

/* ---- making them ---- */

static bool same_plan(const struct plan *a, const struct plan *b)
{
    return a->kind == b->kind && memcmp(&a->material, &b->material, sizeof a->material) == 0 &&
           a->anisotropy == b->anisotropy && memcmp(&a->layers, &b->layers, sizeof a->layers) == 0 &&
           memcmp(&a->coats, &b->coats, sizeof a->coats) == 0;
}

/* The first material with the same table. */
static size_t same_table(const struct kiln_gloss_lobes *lobes, const struct plan *plans, size_t material)
{
    size_t first = 0;
    while (first < material &&
           !(lobes[first].ready == lobes[material].ready && same_plan(&plans[first], &plans[material]) &&
             (!lobes[first].ready || kiln_brushed_same(&lobes[first].lobes, &lobes[material].lobes))))
        first++;
    return first;
}

static void make_table(void *table, const struct plan *p, const struct kiln_gloss_lobes *of)
{
    if (of->ready)
        kiln_brushed_tabulate(table, &of->lobes);
    else if (p->kind == BRUSHED)
        kiln_brushed_stack(table, &p->material, p->anisotropy, p->layers);
    else
        kiln_bsdf_trapped_tabulate(table, &p->material, p->layers, p->coats);
}

/* Sets the table of a material, its own or that of an earlier material, which have the same offset. */
static void use_table(struct kiln_gloss_lobes *of, const struct plan *p, const void *table)
{
    const uint64_t address = (uint64_t)(uintptr_t)table;
    if (of->ready)
        kiln_brushed_use(&of->lobes, table);
    else if (p->kind == BRUSHED) {
        of->tables.brushed_low = (uint32_t)address;
        of->tables.brushed_high = (uint32_t)(address >> 32);
    } else {
        of->tables.trapped_low = (uint32_t)address;
        of->tables.trapped_high = (uint32_t)(address >> 32);
    }
}

/* Adds the tables behind the lobes. `firsts`: same_table of each material. */
static int add_tables(struct kiln_gloss_lobes **lobes, size_t count, const struct plan *plans, const size_t *firsts,
                      const void **tables, struct kiln_error *error)
{
    struct kiln_gloss_lobes *grown = NULL;
    size_t bytes = 0;
    for (size_t i = 0; i < count; i++)
        bytes += firsts[i] == i ? plan_bytes(&plans[i]) : 0;
    if (bytes == 0)
        return KILN_OK;
    const size_t own = count * sizeof **lobes;
    const int status = kiln_allocate(&grown, own + bytes, 1, "the lobes of materials with tables", error);
    if (status != KILN_OK)
        return status;
    char *next = (char *)(grown + count);
    memcpy(grown, *lobes, own);
    for (size_t i = 0; i < count; i++) {
        if (plans[i].kind == NO_TABLE)
            continue;
        tables[i] = firsts[i] == i ? next : tables[firsts[i]];
        if (firsts[i] == i) {
            make_table(next, &plans[i], &grown[i]);
            next += plan_bytes(&plans[i]);
        }
        use_table(&grown[i], &plans[i], tables[i]);
    }
    kiln_free(lobes);
    *lobes = grown;
    return KILN_OK;
}

static int plan_tables(struct kiln_gloss_lobes **lobes, const struct kiln_scene *scene, struct kiln_error *error)
{
    const size_t count = scene->material_count;
    struct kiln_arena arena = {0};
    struct plan *plans = NULL;
    size_t *firsts = NULL;
    const void **tables = NULL;
    int status;
    KILN_TRY(kiln_arena_allocate(&arena, &plans, count, sizeof *plans, "what tables materials need", error));
    KILN_TRY(kiln_arena_allocate(&arena, &firsts, count, sizeof *firsts, "what tables materials need", error));
    KILN_TRY(kiln_arena_allocate(&arena, &tables, count, sizeof *tables, "what tables materials need", error));
    for (size_t i = 0; i < count; i++) {
        plan_of(&plans[i], scene, &(*lobes)[i], (uint32_t)i);
        firsts[i] = plans[i].kind != NO_TABLE ? same_table(*lobes, plans, i) : i;
    }
    KILN_TRY(add_tables(lobes, count, plans, firsts, tables, error));
end:
    kiln_arena_release(&arena);
    return status;
}

int kiln_scene_lobes(struct kiln_gloss_lobes **lobes, const struct kiln_scene *scene, struct kiln_error *error)
{
    const size_t count = scene->material_count;
    *lobes = NULL;
    if (scene->taken == NULL)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_allocate(lobes, count, sizeof **lobes, "the lobes of materials", error));
    for (uint32_t i = 0; i < count; i++)
        (*lobes)[i] = kiln_gloss_lobes(scene, i);
    KILN_TRY(plan_tables(lobes, scene, error));
end:
    if (status != KILN_OK)
        kiln_free(lobes);
    return status;
}

/* ---- what is there ---- */

/* End of a table, in bytes after the lobes; 0: no table. */
static size_t end_of(const struct kiln_gloss_lobes *lobes, size_t count, uint32_t low, uint32_t high, size_t bytes)
{
    const uint64_t address = (uint64_t)high << 32 | low;
    return address == 0 ? 0 : (size_t)(address - (uint64_t)(uintptr_t)(lobes + count)) + bytes;
}

static size_t largest(size_t a, size_t b) { return a > b ? a : b; }

struct kiln_scene_table_bytes kiln_scene_table_bytes(const struct kiln_gloss_lobes *lobes, size_t count)
{
    struct kiln_scene_table_bytes bytes = {0, 0, 0};
    for (size_t i = 0; lobes != NULL && i < count; i++) {
        const struct kiln_bsdf_lobes *own = &lobes[i].lobes;
        const struct kiln_bsdf_tables *t = &lobes[i].tables;
        if (lobes[i].ready)
            bytes.brushed = largest(bytes.brushed, end_of(lobes, count, own->brushed_low, own->brushed_high,
                                                          sizeof(struct kiln_brushed_table)));
        else if ((t->brushed_low | t->brushed_high) != 0) {
            const struct kiln_brushed_table *first = &KILN_BRUSHED_TABLE(t->brushed_low, t->brushed_high, 0);
            bytes.brushed = largest(bytes.brushed, end_of(lobes, count, t->brushed_low, t->brushed_high,
                                                          (1 + (size_t)(first->last - first->first)) * sizeof *first));
        } else
            bytes.trapped = largest(bytes.trapped, end_of(lobes, count, t->trapped_low, t->trapped_high,
                                                          sizeof(struct kiln_bsdf_trapped_table)));
    }
    bytes.all = largest(bytes.brushed, bytes.trapped);
    return bytes;
}
