#include "worker/scene/scene.h"

#include <assert.h>
#include <fcntl.h>
#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "worker/base/calls.h"
#include "worker/base/mapped.h"
#include "worker/base/memory.h"
#include "worker/scene/gloss.h"

enum { SECTION_ALIGNMENT = 64 };

/* The layout of these structs is the file format. */
_Static_assert(sizeof(struct kiln_material) == 68, "format");
_Static_assert(sizeof(struct kiln_normal_map) == 12, "format");
_Static_assert(sizeof(struct kiln_gloss_texture) == 32, "format");
_Static_assert(sizeof(struct kiln_gloss) == 112 + 32 * KILN_GLOSS_USES, "format");
_Static_assert(sizeof(struct kiln_texture) == 40, "format");
_Static_assert(sizeof(struct kiln_mesh) == 56, "format");
_Static_assert(sizeof(struct kiln_object) == 144, "format");
_Static_assert(sizeof(struct kiln_light) == 72, "format");
_Static_assert(sizeof(struct kiln_camera) == 80, "format");
_Static_assert(sizeof(struct kiln_environment) == 32, "format");
_Static_assert(sizeof(struct kiln_source) == 32, "format");
_Static_assert(sizeof(struct kiln_note) == 8, "format");
_Static_assert(sizeof(struct kiln_triangle_source) == 8, "format");
_Static_assert(sizeof(struct kiln_object_settings) == 32, "format");
_Static_assert(sizeof(struct kiln_scene_header) == 136 + 16 * KILN_SECTION_COUNT, "format");

static const struct {
    size_t size;
    const char *name;
} section_kinds[KILN_SECTION_COUNT] = {
    [KILN_SECTION_STRINGS] = {1, "strings"},
    [KILN_SECTION_MATERIALS] = {sizeof(struct kiln_material), "materials"},
    [KILN_SECTION_TEXTURES] = {sizeof(struct kiln_texture), "textures"},
    [KILN_SECTION_TEXELS] = {1, "texels"},
    [KILN_SECTION_MESHES] = {sizeof(struct kiln_mesh), "meshes"},
    [KILN_SECTION_OBJECTS] = {sizeof(struct kiln_object), "objects"},
    [KILN_SECTION_LIGHTS] = {sizeof(struct kiln_light), "lights"},
    [KILN_SECTION_CAMERAS] = {sizeof(struct kiln_camera), "cameras"},
    [KILN_SECTION_ENVIRONMENT] = {sizeof(struct kiln_environment), "environment"},
    [KILN_SECTION_ENVIRONMENT_TEXELS] = {sizeof(float), "environment texels"},
    [KILN_SECTION_POSITIONS] = {sizeof(struct kiln_vec3), "positions"},
    [KILN_SECTION_NORMALS] = {sizeof(struct kiln_vec3), "normals"},
    [KILN_SECTION_TEXCOORD_BASE] = {sizeof(struct kiln_vec2), "base texture coordinates"},
    [KILN_SECTION_TEXCOORD_EMISSION] = {sizeof(struct kiln_vec2), "emission texture coordinates"},
    [KILN_SECTION_TEXCOORD_LIGHTMAP] = {sizeof(struct kiln_vec2), "lightmap coordinates"},
    [KILN_SECTION_COLORS] = {4, "vertex colours"},
    [KILN_SECTION_TRIANGLES] = {3 * sizeof(uint32_t), "triangles"},
    [KILN_SECTION_TRIANGLE_MATERIALS] = {sizeof(uint32_t), "triangle materials"},
    [KILN_SECTION_SOURCES] = {sizeof(struct kiln_source), "sources"},
    [KILN_SECTION_NOTES] = {sizeof(struct kiln_note), "notes"},
    [KILN_SECTION_TRIANGLE_SOURCES] = {sizeof(struct kiln_triangle_source), "triangle sources"},
    [KILN_SECTION_NORMAL_MAPS] = {sizeof(struct kiln_normal_map), "normal maps"},
    [KILN_SECTION_TEXCOORD_NORMAL] = {sizeof(struct kiln_vec2), "normal-map coordinates"},
    [KILN_SECTION_GLOSS] = {sizeof(struct kiln_gloss), "gloss"},
    [KILN_SECTION_TEXCOORD_GLOSS] = {sizeof(struct kiln_vec2), "gloss coordinates"},
    [KILN_SECTION_OBJECT_SETTINGS] = {sizeof(struct kiln_object_settings), "settings of objects"},
};

size_t kiln_scene_element_size(enum kiln_scene_section section)
{
    assert((unsigned)section < KILN_SECTION_COUNT);
    return section_kinds[section].size;
}

const char *kiln_scene_section_name(enum kiln_scene_section section)
{
    assert((unsigned)section < KILN_SECTION_COUNT);
    return section_kinds[section].name;
}

void kiln_scene_content_hash(const struct kiln_scene_header *header, const void *rest, uint64_t hash[2])
{
    /* The header is hashed first, and its hash seeds the hash of the rest. So no streaming state is needed, and no copy
     * of the file. */
    struct kiln_scene_header blank = *header;
    const size_t bytes = kiln_scene_header_bytes(header->version);
    memset(blank.content_hash, 0, sizeof blank.content_hash);
    const XXH64_hash_t seed = XXH3_64bits(&blank, bytes);
    const XXH128_hash_t value = XXH3_128bits_withSeed(rest, (size_t)(header->size - bytes), seed);
    hash[0] = value.low64;
    hash[1] = value.high64;
}

/* Data that the checks need to report where the fault is. */
struct check {
    struct kiln_scene *scene;
    const char *path;
    struct kiln_error *error;
    bool part; /* a part's scene file is wanted */
};

__attribute__((format(printf, 2, 3))) static int damaged(const struct check *check, const char *format, ...)
{
    char text[512];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    return kiln_fail(check->error, KILN_BAD_INPUT, "%s: %s; the scene file is damaged, import the scene again",
                     check->path, text);
}

/* Checks the header, and copies it to the scene with the sections that its version lacks empty. */
static int check_header(const struct check *check, const struct kiln_scene_header *header, uint64_t size)
{
    if (header->magic != KILN_SCENE_MAGIC)
        return kiln_fail(check->error, KILN_BAD_INPUT, "%s: not a kiln scene file (the file signature is missing)",
                         check->path);
    if (!check->part && header->version == KILN_SCENE_VERSION_PART)
        return kiln_fail(check->error, KILN_BAD_INPUT,
                         "%s: is the scene file of a part, without lightmap layouts; give the job that lists the part",
                         check->path);
    if (check->part ? header->version != KILN_SCENE_VERSION_PART
                    : header->version < KILN_SCENE_VERSION_PLAIN || header->version > KILN_SCENE_VERSION)
        return kiln_fail(check->error, KILN_BAD_INPUT,
                         "%s: scene file of version %u, but this kiln reads versions %u to %u; import the scene again",
                         check->path, header->version, KILN_SCENE_VERSION_PLAIN, KILN_SCENE_VERSION);
    uint64_t end = kiln_scene_header_bytes(header->version);
    if (header->size != size || size < end)
        return damaged(check, "the header says %llu bytes, the file has %llu", (unsigned long long)header->size,
                       (unsigned long long)size);
    memcpy(&check->scene->own_header, header, end);
    check->scene->header = &check->scene->own_header;
    for (unsigned s = 0; s < kiln_scene_sections(header->version); s++) {
        const uint64_t offset = header->sections[s].offset, count = header->sections[s].count;
        if (offset % SECTION_ALIGNMENT != 0 || offset < end || offset > size)
            return damaged(check, "section '%s' starts at byte %llu of %llu", section_kinds[s].name,
                           (unsigned long long)offset, (unsigned long long)size);
        if (count > (size - offset) / section_kinds[s].size)
            return damaged(check, "section '%s' has %llu elements, more than the file has room for",
                           section_kinds[s].name, (unsigned long long)count);
        end = offset + count * section_kinds[s].size;
    }
    return KILN_OK;
}

static bool all_finite(const float *values, size_t count)
{
    /* A finite value times zero is zero; anything else times zero is NaN, and NaN stays in the sum. One pass that
     * vectorises. */
    float sum = 0.0f;
    for (size_t i = 0; i < count; i++)
        sum += values[i] * 0.0f;
    return sum == 0.0f;
}

static bool all_finite_double(const double *values, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!isfinite(values[i]))
            return false;
    return true;
}

static bool within(const float *values, size_t count, float low, float high)
{
    for (size_t i = 0; i < count; i++)
        if (!(values[i] >= low && values[i] <= high))
            return false;
    return true;
}

static bool is_string(const struct check *check, uint32_t offset)
{
    return offset < check->scene->header->sections[KILN_SECTION_STRINGS].count;
}

static bool is_texture(const struct check *check, uint32_t index)
{
    return index == KILN_NONE || index < check->scene->texture_count;
}

static int check_materials(const struct check *check)
{
    const struct kiln_scene *scene = check->scene;
    if (scene->material_count == 0)
        return damaged(check, "there is no material");
    for (size_t i = 0; i < scene->material_count; i++) {
        const struct kiln_material *m = &scene->materials[i];
        if (!is_string(check, m->name) || !is_texture(check, m->base_color_texture) ||
            !is_texture(check, m->emission_texture))
            return damaged(check, "material %zu refers to a string or texture that does not exist", i);
        if (m->transmission > 0.0f && !is_texture(check, m->transmission_texture))
            return damaged(check, "material %zu refers to a transmission texture that does not exist", i);
        if (!within(m->base_color, 4, 0.0f, 1.0f) || !within(m->emission, 3, 0.0f, HUGE_VALF) ||
            !all_finite(m->emission, 3) || !within(&m->alpha_cutoff, 1, 0.0f, HUGE_VALF) ||
            !within(&m->metallic, 1, 0.0f, 1.0f) || !within(&m->transmission, 1, 0.0f, 1.0f) ||
            !within(&m->roughness, 1, 0.0f, 1.0f) || m->alpha_mode > KILN_ALPHA_BLEND || m->double_sided > 1)
            return damaged(check, "material %zu has a value outside its range", i);
    }
    return KILN_OK;
}

static int check_textures(const struct check *check)
{
    const struct kiln_scene *scene = check->scene;
    const uint64_t bytes = scene->header->sections[KILN_SECTION_TEXELS].count;
    for (size_t i = 0; i < scene->texture_count; i++) {
        const struct kiln_texture *t = &scene->textures[i];
        const uint64_t pixels = (uint64_t)t->width * t->height;
        if (pixels == 0 || t->first > bytes || pixels > (bytes - t->first) / 4)
            return damaged(check,
                           "texture %zu, %u x %u texels from byte %llu, does not fit into the %llu bytes of texels", i,
                           t->width, t->height, (unsigned long long)t->first, (unsigned long long)bytes);
        if (t->srgb > 1 || t->nearest > 1 || t->wrap_u > KILN_WRAP_MIRROR || t->wrap_v > KILN_WRAP_MIRROR)
            return damaged(check, "texture %zu has an unknown mode", i);
    }
    return KILN_OK;
}

/* Checks a section of coordinates that a scene has if it has any of what they are for. */
static int check_coordinates(const struct check *check, enum kiln_scene_section section, size_t uses,
                             const struct kiln_vec2 *coordinates)
{
    const struct kiln_scene *scene = check->scene;
    const uint64_t known = scene->header->sections[section].count;
    if (known != (uses > 0 ? scene->vertex_count : 0))
        return damaged(check, "there are %llu %s for %zu vertices and %zu materials that have them",
                       (unsigned long long)known, section_kinds[section].name, scene->vertex_count, uses);
    if (known > 0 && !all_finite(&coordinates[0].x, 2 * scene->vertex_count))
        return damaged(check, "one of the %s is not a number", section_kinds[section].name);
    return KILN_OK;
}

static int check_normal_maps(const struct check *check)
{
    const struct kiln_scene *scene = check->scene;
    for (size_t i = 0; i < scene->normal_map_count; i++) {
        const struct kiln_normal_map *map = &scene->normal_maps[i];
        if (map->material >= scene->material_count || map->texture >= scene->texture_count)
            return damaged(check, "normal map %zu refers to a material or texture that does not exist", i);
        if (i > 0 && map->material <= scene->normal_maps[i - 1].material)
            return damaged(check, "normal map %zu does not stand in the order of the materials", i);
        if (!isfinite(map->scale))
            return damaged(check, "normal map %zu has a scale that is not a number", i);
    }
    return check_coordinates(check, KILN_SECTION_TEXCOORD_NORMAL, scene->normal_map_count, scene->texcoord_normal);
}

static int check_glosses(const struct check *check)
{
    const struct kiln_scene *scene = check->scene;
    for (size_t i = 0; i < scene->gloss_count; i++) {
        const char *fault = kiln_gloss_fault(&scene->glosses[i], scene->material_count, scene->texture_count);
        if (fault != NULL)
            return damaged(check, "gloss %zu %s", i, fault);
        if (i > 0 && scene->glosses[i].material <= scene->glosses[i - 1].material)
            return damaged(check, "gloss %zu does not stand in the order of the materials", i);
    }
    return check_coordinates(check, KILN_SECTION_TEXCOORD_GLOSS, scene->gloss_count, scene->texcoord_gloss);
}

static int check_mesh(const struct check *check, size_t index)
{
    const struct kiln_scene *scene = check->scene;
    const struct kiln_mesh *m = &scene->meshes[index];
    if (!is_string(check, m->name))
        return damaged(check, "mesh %zu refers to a string that does not exist", index);
    if (m->vertex_first > scene->vertex_count || m->vertex_count > scene->vertex_count - m->vertex_first ||
        m->triangle_first > scene->triangle_count || m->triangle_count > scene->triangle_count - m->triangle_first)
        return damaged(check, "mesh %zu refers to vertices or triangles that do not exist", index);
    if (!isfinite(m->surface_area) || !isfinite(m->uv_area) || m->surface_area < 0.0 || m->uv_area < 0.0)
        return damaged(check, "mesh %zu has an area that is not a number", index);
    const uint32_t *corners = scene->triangles + 3 * m->triangle_first;
    for (size_t i = 0; i < 3 * m->triangle_count; i++)
        if (corners[i] >= m->vertex_count)
            return damaged(check, "mesh %zu, triangle %zu: corner %u, but there are %llu vertices", index, i / 3,
                           corners[i], (unsigned long long)m->vertex_count);
    const uint32_t *materials = scene->triangle_materials + m->triangle_first;
    for (size_t i = 0; i < m->triangle_count; i++)
        if (materials[i] >= scene->material_count)
            return damaged(check, "mesh %zu, triangle %zu: material %u, but there are %zu materials", index, i,
                           materials[i], scene->material_count);
    return KILN_OK;
}

static int check_vertices(const struct check *check)
{
    const struct kiln_scene *scene = check->scene;
    const size_t n = scene->vertex_count;
    if (!all_finite(&scene->positions[0].x, 3 * n))
        return damaged(check, "a position is not a number");
    if (!all_finite(&scene->texcoord_base[0].x, 2 * n) || !all_finite(&scene->texcoord_emission[0].x, 2 * n))
        return damaged(check, "a texture coordinate is not a number");
    if (check->part ? !all_finite(&scene->texcoord_lightmap[0].x, 2 * n)
                    : !within(&scene->texcoord_lightmap[0].x, 2 * n, 0.0f, 1.0f))
        return damaged(check, "a lightmap coordinate is %s", check->part ? "not a number" : "outside 0..1");
    for (size_t i = 0; i < n; i++) {
        const float squared = vec3_dot(scene->normals[i], scene->normals[i]);
        if (!(squared > 0.99f && squared < 1.01f))
            return damaged(check, "the normal of vertex %zu is not a unit vector", i);
    }
    return KILN_OK;
}

/* Checks that no two meshes share a vertex or a triangle, so that checking all of them takes no longer than reading the
 * file. */
static int check_meshes(const struct check *check)
{
    const struct kiln_scene *scene = check->scene;
    uint64_t vertices = 0, triangles = 0;
    int status = KILN_OK;
    for (size_t i = 0; i < scene->mesh_count && status == KILN_OK; i++) {
        const struct kiln_mesh *m = &scene->meshes[i];
        if (m->vertex_count > scene->vertex_count - vertices || m->triangle_count > scene->triangle_count - triangles)
            return damaged(
                check, "mesh %zu refers to vertices or triangles that another mesh has too, or that do not exist", i);
        vertices += m->vertex_count;
        triangles += m->triangle_count;
        status = check_mesh(check, i);
    }
    return status;
}

static bool is_step_of_name(const char *name, size_t length)
{
    return length > 0 && name[0] != '.' &&
           strspn(name, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-") >= length;
}

/* Whether the name is NAME or PART/NAME, each of which can be the name of a file or folder. */
static bool is_file_name(const char *name)
{
    enum { NAME_MOST = 200 }; /* with an extension it is still a valid name on every file system */
    const size_t length = strnlen(name, NAME_MOST + 1);
    const char *slash = strchr(name, '/');
    if (length > NAME_MOST || slash == NULL)
        return length <= NAME_MOST && is_step_of_name(name, length);
    return is_step_of_name(name, (size_t)(slash - name)) && is_step_of_name(slash + 1, strlen(slash + 1));
}

static int compare_names(const void *a, const void *b)
{
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

/* Checks that objects' names differ: they become file names, and one lightmap would overwrite the other. */
static int check_names(const struct check *check)
{
    const struct kiln_scene *scene = check->scene;
    const char **names = NULL;
    int status = kiln_allocate(&names, scene->object_count, sizeof *names, "the names of objects", check->error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < scene->object_count; i++)
        names[i] = kiln_scene_string(scene, scene->objects[i].name);
    qsort(names, scene->object_count, sizeof *names, compare_names);
    for (size_t i = 1; i < scene->object_count && status == KILN_OK; i++)
        if (strcmp(names[i - 1], names[i]) == 0)
            status = damaged(check, "two objects have the name '%s'", names[i]);
    kiln_free(&names);
    return status;
}

static int check_objects(const struct check *check)
{
    const struct kiln_scene *scene = check->scene;
    for (size_t i = 0; i < scene->object_count; i++) {
        const struct kiln_object *o = &scene->objects[i];
        if (!is_string(check, o->name) || !is_string(check, o->original_name) || o->mesh >= scene->mesh_count)
            return damaged(check, "object %zu refers to a string or mesh that does not exist", i);
        if (!is_file_name(kiln_scene_string(scene, o->name)))
            return damaged(check, "the name of object %zu cannot be a file name", i);
        if (!all_finite_double(o->transform, 12) || o->flipped > 1)
            return damaged(check, "object %zu has a transform that is not a number", i);
        if (o->lightmap_width == 0 || o->lightmap_height == 0 || o->lightmap_width > 65536 ||
            o->lightmap_height > 65536)
            return damaged(check, "object %zu has a lightmap of %u x %u texels", i, o->lightmap_width,
                           o->lightmap_height);
        if (o->density_reason >= KILN_DENSITY_REASONS)
            return damaged(check, "object %zu gives a reason for its density that is none of the %d known ones", i,
                           (int)KILN_DENSITY_REASONS);
    }
    return check_names(check);
}

static int check_object_settings(const struct check *check)
{
    const struct kiln_scene *scene = check->scene;
    const uint64_t count = scene->header->sections[KILN_SECTION_OBJECT_SETTINGS].count;
    if (count != (check->part ? scene->object_count : 0))
        return damaged(check, "there are %llu settings for %zu objects", (unsigned long long)count,
                       scene->object_count);
    for (size_t i = 0; i < count; i++) {
        const struct kiln_object_settings *s = &scene->object_settings[i];
        uint8_t flag;
        memcpy(&flag, &s->size_of_file, sizeof flag);
        if (!(s->density_scale >= 0.0 && s->density_scale <= 1e3) || s->lightmap_size > 65536 ||
            s->role > KILN_ROLE_RECEIVER_ONLY || s->sides > KILN_SIDES_TWO || s->exclude > KILN_EXCLUDE_YES ||
            flag > 1 || !is_string(check, s->lod_name))
            return damaged(check, "the settings of object %zu have a value outside its range", i);
    }
    return KILN_OK;
}

static int check_lights(const struct check *check)
{
    const struct kiln_scene *scene = check->scene;
    for (size_t i = 0; i < scene->light_count; i++) {
        const struct kiln_light *l = &scene->lights[i];
        const float length = sqrtf(l->direction[0] * l->direction[0] + l->direction[1] * l->direction[1] +
                                   l->direction[2] * l->direction[2]);
        if (!is_string(check, l->name) || l->kind > KILN_LIGHT_DIRECTIONAL || !all_finite_double(l->position, 3) ||
            !(fabsf(length - 1.0f) < 0.01f) || !all_finite(l->intensity, 3) ||
            !within(l->intensity, 3, 0.0f, HUGE_VALF) || !isfinite(l->range) || l->range < 0.0f ||
            !within(&l->cos_inner, 1, -1.0f, 1.0f) || !within(&l->cos_outer, 1, -1.0f, 1.0f))
            return damaged(check, "light %zu has a value outside its range", i);
    }
    for (size_t i = 0; i < scene->camera_count; i++) {
        const struct kiln_camera *c = &scene->cameras[i];
        if (!is_string(check, c->name) || c->orthographic > 1 || !all_finite_double(c->position, 3) ||
            !all_finite(c->forward, 3) || !all_finite(c->up, 3) || !all_finite(c->right, 3) || !isfinite(c->extent_y) ||
            !(c->extent_y > 0.0f) || !isfinite(c->aspect) || c->aspect < 0.0f)
            return damaged(check, "camera %zu has a value outside its range", i);
    }
    const struct kiln_environment *e = scene->environment;
    const uint64_t values = scene->header->sections[KILN_SECTION_ENVIRONMENT_TEXELS].count;
    if (e->kind > KILN_ENVIRONMENT_LATLONG || !all_finite(e->radiance, 3) || !within(e->radiance, 3, 0.0f, HUGE_VALF) ||
        !isfinite(e->rotation))
        return damaged(check, "the environment has a value outside its range");
    if (e->kind == KILN_ENVIRONMENT_LATLONG ? e->width == 0 || e->height == 0 || e->width > 65536 ||
                                                  e->height > 65536 || values != 3 * (uint64_t)e->width * e->height
                                            : values != 0)
        return damaged(check, "the environment of %u x %u texels has %llu values", e->width, e->height,
                       (unsigned long long)values);
    if (!all_finite(scene->environment_texels, values) || !within(scene->environment_texels, values, 0.0f, HUGE_VALF))
        return damaged(check, "the environment has a texel that is negative or not a number");
    return KILN_OK;
}

static int check_texts(const struct check *check)
{
    const struct kiln_scene *scene = check->scene;
    const uint64_t bytes = scene->header->sections[KILN_SECTION_STRINGS].count;
    if (bytes == 0 || bytes > UINT32_MAX || scene->strings[bytes - 1] != '\0')
        return damaged(check, "the strings do not end in NUL");
    for (size_t i = 0; i < scene->source_count; i++)
        if (!is_string(check, scene->sources[i].path))
            return damaged(check, "source %zu refers to a string that does not exist", i);
    for (size_t i = 0; i < scene->note_count; i++)
        if (!is_string(check, scene->notes[i].text) || scene->notes[i].severity > KILN_NOTE_UNUSED)
            return damaged(check, "note %zu has an unknown severity or refers to a string that does not exist", i);
    return KILN_OK;
}

static int check_contents(const struct check *check)
{
    const struct kiln_scene *scene = check->scene;
    const struct kiln_scene_header *header = scene->header;
    static const enum kiln_scene_section per_vertex[] = {KILN_SECTION_NORMALS, KILN_SECTION_TEXCOORD_BASE,
                                                         KILN_SECTION_TEXCOORD_EMISSION, KILN_SECTION_TEXCOORD_LIGHTMAP,
                                                         KILN_SECTION_COLORS};
    for (size_t i = 0; i < sizeof per_vertex / sizeof per_vertex[0]; i++)
        if (header->sections[per_vertex[i]].count != scene->vertex_count)
            return damaged(check, "there are %llu %s for %zu vertices",
                           (unsigned long long)header->sections[per_vertex[i]].count, section_kinds[per_vertex[i]].name,
                           scene->vertex_count);
    if (header->sections[KILN_SECTION_TRIANGLE_MATERIALS].count != scene->triangle_count ||
        header->sections[KILN_SECTION_ENVIRONMENT].count != 1)
        return damaged(check, "there are %llu triangle materials for %zu triangles, and %llu environments instead of 1",
                       (unsigned long long)header->sections[KILN_SECTION_TRIANGLE_MATERIALS].count,
                       scene->triangle_count, (unsigned long long)header->sections[KILN_SECTION_ENVIRONMENT].count);
    const uint64_t known = header->sections[KILN_SECTION_TRIANGLE_SOURCES].count;
    if (known != 0 && known != scene->triangle_count)
        return damaged(check, "there are sources of %llu triangles for %zu triangles", (unsigned long long)known,
                       scene->triangle_count);
    if (!all_finite_double(header->centre, 3) || !all_finite_double(header->bounds_min, 3) ||
        !all_finite_double(header->bounds_max, 3) || !isfinite(header->texels_per_metre) ||
        header->texels_per_metre < 0.0f || !isfinite(header->padding_factor) ||
        header->units > KILN_SCENE_UNITS_BLENDER)
        return damaged(check, "the header has a value that is not a number");
    int status;
    KILN_TRY(check_texts(check));
    KILN_TRY(check_materials(check));
    KILN_TRY(check_textures(check));
    KILN_TRY(check_normal_maps(check));
    KILN_TRY(check_glosses(check));
    KILN_TRY(check_meshes(check));
    KILN_TRY(check_vertices(check));
    KILN_TRY(check_objects(check));
    KILN_TRY(check_object_settings(check));
    KILN_TRY(check_lights(check));
end:
    return status;
}

static void set_pointers(struct kiln_scene *scene)
{
    const struct kiln_scene_header *header = scene->header;
    const unsigned char *base = scene->mapped;
#define SECTION(name) ((const void *)(base + header->sections[name].offset))
    scene->strings = SECTION(KILN_SECTION_STRINGS);
    scene->materials = SECTION(KILN_SECTION_MATERIALS);
    scene->textures = SECTION(KILN_SECTION_TEXTURES);
    scene->texels = SECTION(KILN_SECTION_TEXELS);
    scene->meshes = SECTION(KILN_SECTION_MESHES);
    scene->objects = SECTION(KILN_SECTION_OBJECTS);
    scene->lights = SECTION(KILN_SECTION_LIGHTS);
    scene->cameras = SECTION(KILN_SECTION_CAMERAS);
    scene->environment = SECTION(KILN_SECTION_ENVIRONMENT);
    scene->environment_texels = SECTION(KILN_SECTION_ENVIRONMENT_TEXELS);
    scene->positions = SECTION(KILN_SECTION_POSITIONS);
    scene->normals = SECTION(KILN_SECTION_NORMALS);
    scene->texcoord_base = SECTION(KILN_SECTION_TEXCOORD_BASE);
    scene->texcoord_emission = SECTION(KILN_SECTION_TEXCOORD_EMISSION);
    scene->texcoord_lightmap = SECTION(KILN_SECTION_TEXCOORD_LIGHTMAP);
    scene->colors = SECTION(KILN_SECTION_COLORS);
    scene->triangles = SECTION(KILN_SECTION_TRIANGLES);
    scene->triangle_materials = SECTION(KILN_SECTION_TRIANGLE_MATERIALS);
    scene->sources = SECTION(KILN_SECTION_SOURCES);
    scene->notes = SECTION(KILN_SECTION_NOTES);
    scene->triangle_sources =
        header->sections[KILN_SECTION_TRIANGLE_SOURCES].count > 0 ? SECTION(KILN_SECTION_TRIANGLE_SOURCES) : NULL;
    scene->normal_maps = SECTION(KILN_SECTION_NORMAL_MAPS);
    scene->texcoord_normal =
        header->sections[KILN_SECTION_TEXCOORD_NORMAL].count > 0 ? SECTION(KILN_SECTION_TEXCOORD_NORMAL) : NULL;
    scene->glosses = SECTION(KILN_SECTION_GLOSS);
    scene->texcoord_gloss =
        header->sections[KILN_SECTION_TEXCOORD_GLOSS].count > 0 ? SECTION(KILN_SECTION_TEXCOORD_GLOSS) : NULL;
    scene->object_settings =
        header->sections[KILN_SECTION_OBJECT_SETTINGS].count > 0 ? SECTION(KILN_SECTION_OBJECT_SETTINGS) : NULL;
#undef SECTION
    scene->material_count = (size_t)header->sections[KILN_SECTION_MATERIALS].count;
    scene->texture_count = (size_t)header->sections[KILN_SECTION_TEXTURES].count;
    scene->mesh_count = (size_t)header->sections[KILN_SECTION_MESHES].count;
    scene->object_count = (size_t)header->sections[KILN_SECTION_OBJECTS].count;
    scene->light_count = (size_t)header->sections[KILN_SECTION_LIGHTS].count;
    scene->camera_count = (size_t)header->sections[KILN_SECTION_CAMERAS].count;
    scene->vertex_count = (size_t)header->sections[KILN_SECTION_POSITIONS].count;
    scene->triangle_count = (size_t)header->sections[KILN_SECTION_TRIANGLES].count;
    scene->source_count = (size_t)header->sections[KILN_SECTION_SOURCES].count;
    scene->note_count = (size_t)header->sections[KILN_SECTION_NOTES].count;
    scene->normal_map_count = (size_t)header->sections[KILN_SECTION_NORMAL_MAPS].count;
    scene->gloss_count = (size_t)header->sections[KILN_SECTION_GLOSS].count;
}

static int map_file(struct kiln_scene *scene, const char *path, struct kiln_error *error)
{
    struct stat status;
    if (fstat(scene->descriptor, &status) != 0)
        return kiln_fail_errno(error, 0, "%s: cannot read the scene file's size and type", path);
    if (!S_ISREG(status.st_mode))
        return kiln_fail(error, KILN_BAD_INPUT, "%s: not a regular file", path);
    if ((uint64_t)status.st_size < kiln_scene_header_bytes(KILN_SCENE_VERSION_PLAIN))
        return kiln_fail(error, KILN_BAD_INPUT, "%s: not a kiln scene file: its %lld bytes are fewer than a header has",
                         path, (long long)status.st_size);
    void *base = mmap(NULL, (size_t)status.st_size, PROT_READ, MAP_SHARED, scene->descriptor, 0);
    if (base == MAP_FAILED)
        return kiln_fail_errno(error, KILN_SYSTEM, "%s: cannot map the scene file of %lld bytes into memory", path,
                               (long long)status.st_size);
    scene->mapped_bytes = (size_t)status.st_size;
    scene->mapped = base;
    scene->modified = status.st_mtim;
    kiln_mapped_watch(base, scene->mapped_bytes, path);
    return KILN_OK;
}

static void hash_mapped(const struct kiln_scene *scene, uint64_t hash[2])
{
    const unsigned char *base = scene->mapped;
    kiln_scene_content_hash(scene->header, base + kiln_scene_header_bytes(scene->header->version), hash);
}

int kiln_scene_open(struct kiln_scene **result, const char *path, struct kiln_error *error)
{
    *result = NULL;
    /* Without O_NONBLOCK a FIFO of that name would hold the program for ever. */
    const int descriptor = kiln_open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK, 0);
    if (descriptor < 0)
        return kiln_fail_errno(error, 0, "%s: cannot open the scene file", path);
    return kiln_scene_open_descriptor(result, descriptor, path, error);
}

static int open_descriptor(struct kiln_scene **result, int descriptor, const char *path, bool part,
                           struct kiln_error *error)
{
    struct kiln_scene *scene = NULL;
    int status = kiln_allocate(&scene, 1, sizeof *scene, "the scene", error);
    if (status != KILN_OK) {
        (void)close(descriptor);
        *result = NULL;
        return status;
    }
    scene->descriptor = descriptor;
    status = map_file(scene, path, error);
    if (status != KILN_OK)
        goto done;
    const struct check check = {scene, path, error, part};
    status = check_header(&check, scene->mapped, scene->mapped_bytes);
    if (status != KILN_OK)
        goto done;
    uint64_t hash[2];
    hash_mapped(scene, hash);
    if (memcmp(hash, scene->header->content_hash, sizeof hash) != 0) {
        status = damaged(&check, "its bytes do not match its hash");
        goto done;
    }
    set_pointers(scene);
    status = check_contents(&check);
done:
    if (status != KILN_OK)
        kiln_scene_close(&scene);
    *result = scene;
    return status;
}

int kiln_scene_open_descriptor(struct kiln_scene **scene, int descriptor, const char *path, struct kiln_error *error)
{
    return open_descriptor(scene, descriptor, path, false, error);
}

int kiln_scene_open_part(struct kiln_scene **scene, int descriptor, const char *path, struct kiln_error *error)
{
    const int status = open_descriptor(scene, descriptor, path, true, error);
    if (status == KILN_OK) {
        (void)close((*scene)->descriptor);
        (*scene)->descriptor = -1;
    }
    return status;
}

int kiln_scene_check_unchanged(const struct kiln_scene *scene, const char *path, struct kiln_error *error)
{
    struct stat now;
    uint64_t hash[2];
    bool same = fstat(scene->descriptor, &now) == 0 && (size_t)now.st_size == scene->mapped_bytes;
    if (same && (now.st_mtim.tv_sec != scene->modified.tv_sec || now.st_mtim.tv_nsec != scene->modified.tv_nsec)) {
        /* some network file systems change the modification time of unchanged files */
        hash_mapped(scene, hash);
        same = memcmp(hash, scene->header->content_hash, sizeof hash) == 0;
    }
    if (same)
        return KILN_OK;
    return kiln_fail(
        error, KILN_IO,
        "'%s' was changed while kiln was using it: nothing may write to it while kiln runs; run the same command again",
        path);
}

void kiln_scene_close(struct kiln_scene **pointer)
{
    struct kiln_scene *scene = *pointer;
    if (scene == NULL)
        return;
    if (scene->mapped != NULL) {
        kiln_mapped_forget(scene->mapped);
        (void)munmap((void *)(uintptr_t)scene->mapped, scene->mapped_bytes);
    }
    if (scene->descriptor >= 0)
        (void)close(scene->descriptor);
    kiln_free(&scene->taken);
    kiln_free(&scene->panes);
    kiln_free(&scene->own_materials);
    kiln_free(pointer);
}
