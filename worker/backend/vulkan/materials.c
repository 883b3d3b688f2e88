#include "worker/backend/vulkan/materials.h"

#include <math.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/material/scene_lobes.h"
#include "worker/scene/texture.h"

/* size of a buffer that every device can allocate */
static const uint64_t most_texel_bytes = (uint64_t)1 << 30;

/* Materials made on the host before they are uploaded. */
struct staging {
    const struct kiln_backend_params *params;
    struct gpu *gpu;
    bool all;   /* triangles are coated */
    bool gloss; /* kernels need more than the diffuse part of materials */
    struct kiln_gpu_material *materials;
    struct kiln_gpu_texture *textures;
    struct kiln_gpu_coating *coatings;
    struct kiln_gpu_gloss *glosses;            /* per material; NULL: kernels treat all as diffuse */
    struct kiln_gpu_gloss_place *gloss_places; /* per coating; NULL: none */
    struct kiln_bsdf_lobes *lobes;             /* per material; NULL: as `glosses` */
    bool varied;                               /* not all of these are prepared */
    struct kiln_vec3 *normals;                 /* per world triangle that is not opaque; NULL: no panes */
    uint32_t *slots;
    uint32_t *coating_of; /* stored triangle -> its coating, KILN_NONE: none yet */
    bool *wanted;         /* texture */
    size_t slot_first, slot_count, coating_count;
    struct kiln_arena arena;
};

bool vulkan_materials_holds(const struct kiln_backend_params *params, uint32_t triangle)
{
    const struct kiln_geometry *g = params->geometry;
    const uint32_t word = g->records[triangle].material;
    return triangle >= g->opaque_count ||
           ((word & KILN_RECORD_EMITS) != 0 &&
            params->scene->materials[word & KILN_RECORD_MATERIAL].emission_texture != KILN_NONE);
}

/* Finds what has textures, KILN_TEXTURED_..., whatever is on the device. */
static uint32_t textured_of(const struct kiln_backend_params *params)
{
    const struct kiln_geometry *g = params->geometry;
    uint32_t textured = 0;
    for (size_t i = 0; i < g->triangle_count; i++) {
        const uint32_t word = g->records[i].material;
        const struct kiln_material *m = &params->scene->materials[word & KILN_RECORD_MATERIAL];
        const bool color = m->base_color_texture != KILN_NONE, lets = i >= g->opaque_count;
        textured |= (color ? KILN_TEXTURED_COLOR : 0u) |
                    (lets && (color || m->transmission_texture != KILN_NONE) ? KILN_TEXTURED_PASSAGE : 0u) |
                    (m->emission_texture != KILN_NONE ? KILN_TEXTURED_EMISSION : 0u);
    }
    return textured;
}

static bool is_coated(const struct staging *s, uint32_t triangle)
{
    return s->all || vulkan_materials_holds(s->params, triangle);
}

/* Finds the shortest range of world triangles that contains all that need a coating. */
static void find_slots(struct staging *s)
{
    const struct kiln_geometry *g = s->params->geometry;
    size_t end = g->triangle_count;
    while (s->slot_first < end && !is_coated(s, (uint32_t)s->slot_first))
        s->slot_first++;
    while (end > s->slot_first && !is_coated(s, (uint32_t)(end - 1)))
        end--;
    s->slot_count = end - s->slot_first;
}

bool vulkan_materials_take_gloss(const struct kiln_scene *scene)
{
    for (uint32_t i = 0; i < scene->material_count; i++)
        if (kiln_gloss_taken(scene, i) != NULL)
            return true;
    return false;
}

/* The uses of textures in the order of KILN_GPU_GLOSS_... */
static const enum kiln_gloss_use gloss_uses[KILN_GPU_GLOSS_USES] = {
    [KILN_GPU_GLOSS_METALLIC] = KILN_GLOSS_METALLIC,
    [KILN_GPU_GLOSS_ROUGHNESS] = KILN_GLOSS_ROUGHNESS,
    [KILN_GPU_GLOSS_TRANSMISSION] = KILN_GLOSS_TRANSMISSION,
    [KILN_GPU_GLOSS_SPECULAR] = KILN_GLOSS_SPECULAR,
    [KILN_GPU_GLOSS_SPECULAR_COLOR] = KILN_GLOSS_SPECULAR_COLOR,
    [KILN_GPU_GLOSS_COAT] = KILN_GLOSS_CLEARCOAT,
    [KILN_GPU_GLOSS_COAT_ROUGHNESS] = KILN_GLOSS_CLEARCOAT_ROUGHNESS,
    [KILN_GPU_GLOSS_ANISOTROPY] = KILN_GLOSS_ANISOTROPY};

static void want_gloss_textures(struct staging *s, uint32_t material)
{
    const struct kiln_gloss *gloss = kiln_gloss_taken(s->params->scene, material);
    for (size_t i = 0; i < KILN_GPU_GLOSS_USES && gloss != NULL; i++)
        if (gloss->textures[gloss_uses[i]].texture != KILN_NONE)
            s->wanted[gloss->textures[gloss_uses[i]].texture] = true;
}

static void want_textures(struct staging *s, uint32_t triangle, const struct kiln_material *material)
{
    if (s->gloss)
        want_gloss_textures(s, (uint32_t)(material - s->params->scene->materials));
    if ((s->all || triangle >= s->params->geometry->opaque_count) && material->base_color_texture != KILN_NONE)
        s->wanted[material->base_color_texture] = true;
    if (triangle >= s->params->geometry->opaque_count && material->transmission > 0.0f &&
        material->transmission_texture != KILN_NONE)
        s->wanted[material->transmission_texture] = true;
    if ((s->params->geometry->records[triangle].material & KILN_RECORD_EMITS) != 0 &&
        material->emission_texture != KILN_NONE)
        s->wanted[material->emission_texture] = true;
}

static void fill_coating(struct kiln_gpu_coating *coating, const struct kiln_scene *scene, uint32_t mesh,
                         uint32_t stored)
{
    const uint64_t first = scene->meshes[mesh].vertex_first;
    for (size_t c = 0; c < 3; c++) {
        const uint64_t vertex = first + scene->triangles[3 * (size_t)stored + c];
        const struct kiln_vec2 base = scene->texcoord_base[vertex], emission = scene->texcoord_emission[vertex];
        coating->base[2 * c] = base.x;
        coating->base[2 * c + 1] = base.y;
        coating->emission[2 * c] = emission.x;
        coating->emission[2 * c + 1] = emission.y;
        memcpy(&coating->colors[c], scene->colors + 4 * vertex, 4);
    }
    coating->material = scene->triangle_materials[stored];
}

static void fill_gloss_place(struct kiln_gpu_gloss_place *place, const struct kiln_scene *scene, uint32_t mesh,
                             uint32_t stored)
{
    const uint64_t first = scene->meshes[mesh].vertex_first;
    for (size_t c = 0; c < 3; c++) {
        const struct kiln_vec2 at = scene->texcoord_gloss[first + scene->triangles[3 * (size_t)stored + c]];
        place->at[2 * c] = at.x;
        place->at[2 * c + 1] = at.y;
    }
}

/* Numbers the coatings in the order in which world triangles first use them. */
static void number_coatings(struct staging *s)
{
    const struct kiln_geometry *g = s->params->geometry;
    const struct kiln_scene *scene = s->params->scene;
    memset(s->coating_of, 0xff, scene->triangle_count * sizeof *s->coating_of);
    for (size_t i = 0; i < s->slot_count; i++) {
        const uint32_t triangle = (uint32_t)(s->slot_first + i), stored = g->stored_triangle[triangle];
        s->slots[i] = KILN_GPU_NONE;
        if (!is_coated(s, triangle))
            continue;
        if (s->coating_of[stored] == KILN_NONE)
            s->coating_of[stored] = (uint32_t)s->coating_count++;
        s->slots[i] =
            s->coating_of[stored] | (scene->objects[g->records[triangle].object].flipped ? KILN_GPU_FLIPPED : 0u);
        want_textures(s, triangle, &scene->materials[g->records[triangle].material & KILN_RECORD_MATERIAL]);
    }
}

static void fill_coatings(struct staging *s)
{
    const struct kiln_geometry *g = s->params->geometry;
    const struct kiln_scene *scene = s->params->scene;
    for (size_t i = 0; i < s->slot_count; i++)
        if (s->slots[i] != KILN_GPU_NONE) {
            const size_t triangle = s->slot_first + i, slot = s->slots[i] & ~KILN_GPU_FLIPPED;
            const uint32_t mesh = scene->objects[g->records[triangle].object].mesh;
            fill_coating(&s->coatings[slot], scene, mesh, g->stored_triangle[triangle]);
            if (s->gloss_places != NULL)
                fill_gloss_place(&s->gloss_places[slot], scene, mesh, g->stored_triangle[triangle]);
        }
}

static void fill_gloss_textures(struct kiln_gpu_gloss *to, const struct kiln_gloss *from)
{
    for (size_t i = 0; i < KILN_GPU_GLOSS_USES; i++) {
        const struct kiln_gloss_texture *t = &from->textures[gloss_uses[i]];
        to->textures[i].texture = t->texture;
        to->textures[i].channel = t->channel;
        memcpy(to->textures[i].transform, t->transform, sizeof t->transform);
        if (t->texture != KILN_NONE)
            to->flags |= KILN_GPU_GLOSS_TEXTURED;
    }
}

static void fill_gloss(struct kiln_gpu_gloss *to, const struct kiln_gloss *from)
{
    const struct kiln_vec3 eta = kiln_gloss_index(from);
    *to = (struct kiln_gpu_gloss){.flags = KILN_GPU_GLOSS_TAKEN,
                                  .metallic = from->metallic,
                                  .roughness = from->roughness,
                                  .specular = from->specular,
                                  .transmission = from->transmission,
                                  .eta = {eta.x, eta.y, eta.z},
                                  .attenuation_distance = from->attenuation_distance,
                                  .coat = from->clearcoat,
                                  .coat_roughness = from->clearcoat_roughness,
                                  .anisotropy = from->anisotropy,
                                  .exponent = from->exponent,
                                  .turn_cosine = cosf(from->anisotropy_rotation),
                                  .turn_sine = sinf(from->anisotropy_rotation)};
    memcpy(to->specular_color, from->specular_color, sizeof to->specular_color);
    memcpy(to->filter_color, from->filter, sizeof to->filter_color);
    memcpy(to->attenuation_color, from->attenuation_color, sizeof to->attenuation_color);
    to->flags |= (from->flags & KILN_GLOSS_VOLUME) != 0 ? KILN_GPU_GLOSS_VOLUME : 0u;
    to->flags |= (from->flags & KILN_GLOSS_MIRROR) != 0 ? KILN_GPU_GLOSS_MIRROR : 0u;
    to->flags |= from->model == KILN_GLOSS_PHONG ? KILN_GPU_GLOSS_PHONG : 0u;
    to->flags |= from->transmission > 0.0f ? KILN_GPU_GLOSS_TRANSMITS : 0u;
    fill_gloss_textures(to, from);
}

/* Converts the host pointer of a table to its device address, in two words; 0 if there is no table. */
static void move_table(const struct staging *s, const struct vulkan_materials *m, uint32_t *low, uint32_t *high)
{
    const uint64_t host = (uint64_t)*high << 32 | *low;
    if (host == 0)
        return;
    const uint64_t first = (uint64_t)(uintptr_t)kiln_scene_tables(m->lobes, s->params->scene->material_count);
    const uint64_t address = m->tables.address + (host - first);
    *low = (uint32_t)address;
    *high = (uint32_t)(address >> 32);
}

/* Kinds of lobes that a material without prepared lobes may have, whatever its textures hold. */
static uint32_t varied_kinds(const struct kiln_gpu_gloss *g)
{
    const bool glass = g->transmission > 0.0f, older = (g->flags & KILN_GPU_GLOSS_PHONG) != 0;
    return KILN_BSDF_MAY_MIRROR | (g->coat > 0.0f ? KILN_BSDF_MAY_COAT : 0u) |
           (glass ? KILN_BSDF_MAY_GLASS | KILN_BSDF_MAY_ROUGH_GLASS : 0u) |
           (g->anisotropy > 0.0f ? KILN_BSDF_MAY_ACROSS : 0u) | (older ? KILN_BSDF_MAY_OLDER : 0u) |
           (g->eta[0] != g->eta[1] || g->eta[2] != g->eta[1] ? KILN_BSDF_MAY_DISPERSE : 0u);
}

static uint32_t kinds_of(const struct kiln_bsdf_lobes *l)
{
    const bool mirror = l->base_is_mirror != 0, glass = l->glass > 0.0f;
    return (l->coat.strength > 0.0f ? KILN_BSDF_MAY_COAT : 0u) | (glass ? KILN_BSDF_MAY_GLASS : 0u) |
           (glass && !mirror ? KILN_BSDF_MAY_ROUGH_GLASS : 0u) | (mirror ? KILN_BSDF_MAY_MIRROR : 0u) |
           (l->alpha_x != l->alpha_y ? KILN_BSDF_MAY_ACROSS : 0u) |
           (l->p.model != KILN_BSDF_LAYERS ? KILN_BSDF_MAY_OLDER : 0u) |
           (l->disperses != 0 ? KILN_BSDF_MAY_DISPERSE : 0u);
}

static void prepare_lobes(struct staging *s, struct vulkan_materials *m, uint32_t material)
{
    const struct kiln_gloss_lobes *of = &m->lobes[material];
    struct kiln_gpu_gloss *gloss = &s->glosses[material];
    if (!of->ready) {
        gloss->brushed[0] = of->tables.brushed_low;
        gloss->brushed[1] = of->tables.brushed_high;
        gloss->trapped[0] = of->tables.trapped_low;
        gloss->trapped[1] = of->tables.trapped_high;
        move_table(s, m, &gloss->brushed[0], &gloss->brushed[1]);
        move_table(s, m, &gloss->trapped[0], &gloss->trapped[1]);
        s->varied = true;
        m->lobe_kinds |= varied_kinds(gloss);
        return;
    }
    gloss->flags |= KILN_GPU_GLOSS_PREPARED | (of->dyed ? KILN_GPU_GLOSS_DYED : 0u);
    s->lobes[material] = of->lobes;
    m->lobe_kinds |= kinds_of(&of->lobes) | (gloss->anisotropy > 0.0f ? KILN_BSDF_MAY_ACROSS : 0u);
    move_table(s, m, &s->lobes[material].brushed_low, &s->lobes[material].brushed_high);
}

/* Computes the lobes on the host, and their tables. */
static int prepare_tables(struct staging *s, struct vulkan_materials *m, struct kiln_error *error)
{
    const struct kiln_scene *scene = s->params->scene;
    int status = kiln_scene_lobes(&m->lobes, scene, error);
    if (status != KILN_OK)
        return status;
    const struct kiln_scene_table_bytes bytes = kiln_scene_table_bytes(m->lobes, scene->material_count);
    m->brushed = bytes.brushed != 0;
    m->trapped = bytes.trapped != 0;
    if (bytes.all != 0)
        status = gpu_buffer_of(s->gpu, &m->tables, kiln_scene_tables(m->lobes, scene->material_count), bytes.all,
                               "the tables of materials", error);
    return status;
}

static int make_glosses(struct staging *s, struct vulkan_materials *m, struct kiln_error *error)
{
    const struct kiln_scene *scene = s->params->scene;
    if (!s->gloss)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->glosses, scene->material_count, sizeof *s->glosses,
                                 "the device's gloss", error));
    if (scene->texcoord_gloss != NULL)
        KILN_TRY(kiln_arena_allocate(&s->arena, &s->gloss_places, s->coating_count, sizeof *s->gloss_places,
                                     "the texture coordinates of gloss", error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->lobes, scene->material_count, sizeof *s->lobes,
                                 "the lobes of materials", error));
    KILN_TRY(prepare_tables(s, m, error));
    for (uint32_t i = 0; i < scene->material_count; i++) {
        const struct kiln_gloss *gloss = kiln_gloss_taken(scene, i);
        if (gloss != NULL) {
            fill_gloss(&s->glosses[i], gloss);
            prepare_lobes(s, m, i);
        }
    }
end:
    return status;
}

static void fill_materials(struct staging *s)
{
    const struct kiln_scene *scene = s->params->scene;
    for (size_t i = 0; i < scene->material_count; i++) {
        const struct kiln_material *from = &scene->materials[i];
        struct kiln_gpu_material *to = &s->materials[i];
        to->base_alpha = from->base_color[3];
        memcpy(to->emission, from->emission, sizeof to->emission);
        to->alpha_cutoff = from->alpha_cutoff;
        to->alpha_mode = from->alpha_mode;
        to->base_color_texture = from->base_color_texture;
        to->emission_texture = from->emission_texture;
        for (int c = 0; c < 3; c++)
            to->base_color[c] = from->base_color[c] * (1.0f - from->metallic);
        memcpy(to->seen_color, from->base_color, sizeof to->seen_color);
        to->transmission = from->transmission;
        to->transmission_texture = from->transmission > 0.0f ? from->transmission_texture : KILN_NONE;
        if (scene->panes != NULL)
            to->pane = scene->panes[i];
    }
}

static int make_normals(struct staging *s, struct kiln_error *error)
{
    const struct kiln_geometry *g = s->params->geometry;
    if (g->passage < KILN_PASSAGE_PANE)
        return KILN_OK;
    const int status = kiln_arena_allocate(&s->arena, &s->normals, g->triangle_count - g->opaque_count,
                                           sizeof *s->normals, "the normals of panes", error);
    for (size_t t = g->opaque_count; t < g->triangle_count && status == KILN_OK; t++) {
        struct kiln_vec3 corner[3];
        kiln_geometry_corners(g, (uint32_t)t, corner);
        const struct kiln_vec3 normal = vec3_cross(vec3_sub(corner[1], corner[0]), vec3_sub(corner[2], corner[0]));
        const float length = vec3_length(normal);
        s->normals[t - g->opaque_count] = length > 0.0f ? vec3_scale(normal, 1.0f / length) : normal;
    }
    return status;
}

static int make_staging(struct staging *s, struct vulkan_materials *m, struct kiln_error *error)
{
    const struct kiln_scene *scene = s->params->scene;
    int status =
        kiln_arena_allocate(&s->arena, &s->slots, s->slot_count, sizeof *s->slots, "the coated triangles", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&s->arena, &s->coating_of, scene->triangle_count, sizeof *s->coating_of,
                                     "the coatings' numbers", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&s->arena, &s->materials, scene->material_count, sizeof *s->materials,
                                     "the device's materials", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&s->arena, &s->textures, scene->texture_count, sizeof *s->textures,
                                     "the device's textures", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&s->arena, &s->wanted, scene->texture_count, sizeof *s->wanted,
                                     "the list of textures", error);
    if (status != KILN_OK)
        return status;
    number_coatings(s);
    kiln_arena_free(&s->arena, &s->coating_of);
    if (s->coating_count > KILN_GPU_FLIPPED - 1)
        return kiln_fail(error, KILN_NO_DEVICE,
                         "%zu triangles whose colours, alpha or emission kernels ask for are more than the Vulkan "
                         "backend's %u: bake with Embree",
                         s->coating_count, KILN_GPU_FLIPPED - 1);
    status = kiln_arena_allocate(&s->arena, &s->coatings, s->coating_count, sizeof *s->coatings, "the coatings", error);
    if (status == KILN_OK)
        status = make_glosses(s, m, error);
    if (status == KILN_OK)
        status = make_normals(s, error);
    if (status != KILN_OK)
        return status;
    fill_coatings(s);
    fill_materials(s);
    return KILN_OK;
}

static void free_staging(struct staging *s) { kiln_arena_release(&s->arena); }

static uint64_t texture_bytes(const struct kiln_texture *t) { return 4 * (uint64_t)t->width * t->height; }

/* Number of textures from `first` on that fit into one buffer; *bytes: its size. */
static size_t run_of_textures(const struct staging *s, size_t first, uint64_t *bytes)
{
    const struct kiln_scene *scene = s->params->scene;
    const uint64_t most = gpu_guarded(s->gpu) ? 1 : most_texel_bytes; /* 1: each in a buffer of its own */
    size_t i = first;
    *bytes = 0;
    for (; i < scene->texture_count; i++) {
        const uint64_t own = s->wanted[i] ? texture_bytes(&scene->textures[i]) : 0;
        if (*bytes != 0 && own != 0 && *bytes + own > most)
            break;
        *bytes += own;
    }
    return i - first;
}

static int upload_run(struct staging *s, struct gpu_buffer *buffer, size_t first, size_t count, uint64_t bytes,
                      struct kiln_error *error)
{
    const struct kiln_scene *scene = s->params->scene;
    int status = gpu_buffer_create(s->gpu, buffer, bytes, GPU_DEVICE, "the textures", error);
    uint64_t offset = 0;
    for (size_t i = first; i < first + count && status == KILN_OK; i++) {
        const struct kiln_texture *t = &scene->textures[i];
        if (!s->wanted[i])
            continue;
        s->textures[i] = (struct kiln_gpu_texture){.texels = buffer->address + offset,
                                                   .width = t->width,
                                                   .height = t->height,
                                                   .srgb = t->srgb,
                                                   .nearest = t->nearest,
                                                   .wrap_u = t->wrap_u,
                                                   .wrap_v = t->wrap_v};
        status = gpu_upload(s->gpu, buffer, offset, scene->texels + t->first, texture_bytes(t), error);
        offset += texture_bytes(t);
    }
    return status;
}

static int upload_texels(struct staging *s, struct vulkan_materials *m, struct kiln_error *error)
{
    size_t room = 0;
    int status = KILN_OK;
    for (size_t first = 0, count; first < s->params->scene->texture_count && status == KILN_OK; first += count) {
        uint64_t bytes;
        count = run_of_textures(s, first, &bytes);
        if (bytes == 0)
            continue;
        status =
            kiln_grow(&m->texels, &room, m->texel_buffers + 1, sizeof *m->texels, "the list of texel buffers", error);
        if (status != KILN_OK)
            break;
        m->texels[m->texel_buffers] = (struct gpu_buffer){0};
        status = upload_run(s, &m->texels[m->texel_buffers++], first, count, bytes, error);
    }
    return status;
}

static int upload_all(struct staging *s, struct vulkan_materials *m, struct kiln_gpu_materials *layout,
                      struct kiln_error *error)
{
    const struct kiln_scene *scene = s->params->scene;
    const size_t glosses = s->glosses != NULL ? scene->material_count : 0,
                 places = s->gloss_places != NULL ? s->coating_count : 0,
                 normals =
                     s->normals != NULL ? s->params->geometry->triangle_count - s->params->geometry->opaque_count : 0;
    float linear[256];
    kiln_texture_codes(linear);
    const struct {
        const void *data;
        size_t bytes;
        const char *what;
        uint64_t *address;
    } parts[VULKAN_MATERIAL_BUFFERS] = {
        {s->materials, scene->material_count * sizeof *s->materials, "the materials", &layout->materials},
        {s->textures, scene->texture_count * sizeof *s->textures, "the list of textures", &layout->textures},
        {s->coatings, s->coating_count * sizeof *s->coatings, "the coatings", &layout->coatings},
        {s->slots, s->slot_count * sizeof *s->slots, "the coated triangles", &layout->slots},
        {linear, sizeof linear, "the table of sRGB codes", &layout->linear_of_srgb},
        {s->glosses, glosses * sizeof *s->glosses, "the gloss of materials", &layout->glosses},
        {s->gloss_places, places * sizeof *s->gloss_places, "the texture coordinates of gloss", &layout->gloss_places},
        {s->lobes, glosses * sizeof *s->lobes, "the lobes of materials", &layout->lobes},
        {s->normals, normals * sizeof *s->normals, "the normals of panes", &layout->normals},
    };
    int status = KILN_OK;
    for (size_t i = 0; i < VULKAN_MATERIAL_BUFFERS && status == KILN_OK; i++) {
        status = gpu_buffer_of(s->gpu, &m->buffers[i], parts[i].data, parts[i].bytes, parts[i].what, error);
        *parts[i].address = m->buffers[i].address;
    }
    layout->slot_first = (uint32_t)s->slot_first;
    return status;
}

int vulkan_materials_create(struct gpu *gpu, const struct kiln_backend_params *params, bool all,
                            struct vulkan_materials *materials, struct kiln_gpu_materials *layout,
                            struct kiln_error *error)
{
    struct staging s = {
        .params = params, .gpu = gpu, .all = all, .gloss = all && vulkan_materials_take_gloss(params->scene)};
    *materials = (struct vulkan_materials){.textured = textured_of(params)};
    *layout = (struct kiln_gpu_materials){0};
    find_slots(&s);
    if (s.slot_count == 0)
        return KILN_OK;
    int status;
    KILN_TRY(make_staging(&s, materials, error));
    KILN_TRY(upload_texels(&s, materials, error));
    KILN_TRY(upload_all(&s, materials, layout, error));
end:
    materials->gloss = s.glosses != NULL;
    materials->varied = s.varied;
    free_staging(&s);
    if (status != KILN_OK)
        vulkan_materials_destroy(gpu, materials);
    return status;
}

void vulkan_materials_destroy(struct gpu *gpu, struct vulkan_materials *materials)
{
    for (size_t i = 0; i < VULKAN_MATERIAL_BUFFERS; i++)
        gpu_buffer_destroy(gpu, &materials->buffers[i]);
    gpu_buffer_destroy(gpu, &materials->tables);
    for (size_t i = 0; i < materials->texel_buffers; i++)
        gpu_buffer_destroy(gpu, &materials->texels[i]);
    kiln_free(&materials->lobes);
    kiln_free(&materials->texels);
    materials->texel_buffers = 0;
}
