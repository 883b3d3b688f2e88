#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/import/assemble.h"
#include "coordinator/import/lods.h"
#include "coordinator/import/parts_private.h"
#include "worker/base/affine.h"
#include "worker/base/memory.h"

static const char *string(const struct kiln_open_part *part, uint32_t offset)
{
    return kiln_scene_string(part->scene, offset);
}

/* Writes PART/NAME, of a further place PART.2/NAME, to m->text. */
static int compose_name(struct kiln_merger *m, const struct kiln_open_part *part, size_t place, const char *name)
{
    const size_t room = strlen(part->name) + strlen(name) + 32;
    const int status = kiln_grow(&m->text, &m->text_room, room, 1, "the name of an object", m->error);
    if (status == KILN_OK && place == 0)
        (void)snprintf(m->text, m->text_room, "%s/%s", part->name, name);
    else if (status == KILN_OK)
        (void)snprintf(m->text, m->text_room, "%s.%zu/%s", part->name, place + 1, name);
    return status;
}

static int add_name(struct kiln_merger *m, const struct kiln_open_part *part, size_t place, uint32_t *offset)
{
    int status = compose_name(m, part, place, string(part, *offset));
    return status != KILN_OK ? status : kiln_builder_string(m->builder, m->text, strlen(m->text), offset, m->error);
}

/* Appends a section of a part as it is; gives the index of the first element. */
static int append(struct kiln_merger *m, const struct kiln_open_part *part, enum kiln_scene_section section,
                  size_t *first)
{
    const struct kiln_scene_header *header = part->scene->header;
    return kiln_builder_append(m->builder, section,
                               (const unsigned char *)part->scene->mapped + header->sections[section].offset,
                               (size_t)header->sections[section].count, first, m->error);
}

/* ---- materials and textures ---- */

static void move_index(uint32_t *index, size_t by)
{
    if (*index != KILN_NONE)
        *index += (uint32_t)by;
}

static int append_materials(struct kiln_merger *m, struct kiln_open_part *part)
{
    int status;
    KILN_TRY(append(m, part, KILN_SECTION_MATERIALS, &part->materials));
    for (size_t i = 0; i < part->scene->material_count; i++) {
        uint32_t name = part->scene->materials[i].name;
        KILN_TRY(add_name(m, part, 0, &name));
        struct kiln_material *material =
            &KILN_BUILDER_DATA(m->builder, struct kiln_material, KILN_SECTION_MATERIALS)[part->materials + i];
        material->name = name;
        move_index(&material->base_color_texture, part->textures);
        move_index(&material->emission_texture, part->textures);
        /* unchecked where nothing is transmitted */
        if (material->transmission_texture >= part->scene->texture_count)
            material->transmission_texture = KILN_NONE;
        move_index(&material->transmission_texture, part->textures);
    }
end:
    return status;
}

static int append_textures(struct kiln_merger *m, struct kiln_open_part *part)
{
    size_t texels = 0;
    int status;
    KILN_TRY(append(m, part, KILN_SECTION_TEXTURES, &part->textures));
    KILN_TRY(append(m, part, KILN_SECTION_TEXELS, &texels));
    struct kiln_texture *textures =
        KILN_BUILDER_DATA(m->builder, struct kiln_texture, KILN_SECTION_TEXTURES) + part->textures;
    for (size_t i = 0; i < part->scene->texture_count; i++)
        textures[i].first += texels;
end:
    return status;
}

static int append_normal_maps(struct kiln_merger *m, const struct kiln_open_part *part)
{
    size_t first = 0;
    const int status = append(m, part, KILN_SECTION_NORMAL_MAPS, &first);
    for (size_t i = 0; status == KILN_OK && i < part->scene->normal_map_count; i++) {
        struct kiln_normal_map *map =
            &KILN_BUILDER_DATA(m->builder, struct kiln_normal_map, KILN_SECTION_NORMAL_MAPS)[first + i];
        map->material += (uint32_t)part->materials;
        map->texture += (uint32_t)part->textures;
    }
    return status;
}

static int append_glosses(struct kiln_merger *m, const struct kiln_open_part *part)
{
    size_t first = 0;
    const int status = append(m, part, KILN_SECTION_GLOSS, &first);
    for (size_t i = 0; status == KILN_OK && i < part->scene->gloss_count; i++) {
        struct kiln_gloss *gloss = &KILN_BUILDER_DATA(m->builder, struct kiln_gloss, KILN_SECTION_GLOSS)[first + i];
        gloss->material += (uint32_t)part->materials;
        for (int use = 0; use < KILN_GLOSS_USES; use++)
            move_index(&gloss->textures[use].texture, part->textures);
    }
    return status;
}

/* ---- meshes ---- */

/* Appends coordinates that only scenes with normal maps or gloss have; a part without them has its base coordinates. */
static int append_coordinates(struct kiln_merger *m, const struct kiln_open_part *part, enum kiln_scene_section section)
{
    const bool own = part->scene->header->sections[section].count > 0;
    return kiln_builder_has(m->builder, section)
               ? own ? append(m, part, section, NULL)
                     : kiln_builder_append(m->builder, section, part->scene->texcoord_base, part->scene->vertex_count,
                                           NULL, m->error)
               : KILN_OK;
}

static int append_meshes(struct kiln_merger *m, struct kiln_open_part *part, size_t vertices, size_t triangles)
{
    int status;
    KILN_TRY(append(m, part, KILN_SECTION_MESHES, &part->meshes));
    for (size_t i = 0; i < part->scene->mesh_count; i++) {
        uint32_t name = part->scene->meshes[i].name;
        KILN_TRY(add_name(m, part, 0, &name));
        struct kiln_mesh *mesh =
            &KILN_BUILDER_DATA(m->builder, struct kiln_mesh, KILN_SECTION_MESHES)[part->meshes + i];
        mesh->name = name;
        mesh->vertex_first += vertices;
        mesh->triangle_first += triangles;
        m->builder->mesh_has_lightmap_uv[part->meshes + i] =
            (mesh->flags & KILN_MESH_SOUND_SECOND_UV) != 0 ? KILN_LIGHTMAP_UV_SOUND
            : (mesh->flags & KILN_MESH_HAS_SECOND_UV) != 0 ? KILN_LIGHTMAP_UV_GIVEN
                                                           : KILN_LIGHTMAP_UV_NONE;
        mesh->flags &= ~(uint32_t)(KILN_MESH_HAS_SECOND_UV | KILN_MESH_SOUND_SECOND_UV);
    }
end:
    return status;
}

static int append_geometry(struct kiln_merger *m, struct kiln_open_part *part)
{
    static const enum kiln_scene_section others[] = {
        KILN_SECTION_NORMALS,           KILN_SECTION_TEXCOORD_BASE, KILN_SECTION_TEXCOORD_EMISSION,
        KILN_SECTION_TEXCOORD_LIGHTMAP, KILN_SECTION_COLORS,        KILN_SECTION_TRIANGLE_MATERIALS};
    size_t vertices = 0, triangles = 0;
    int status;
    KILN_TRY(append(m, part, KILN_SECTION_POSITIONS, &vertices));
    KILN_TRY(append(m, part, KILN_SECTION_TRIANGLES, &triangles));
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        KILN_TRY(append(m, part, others[i], NULL));
    KILN_TRY(append_coordinates(m, part, KILN_SECTION_TEXCOORD_NORMAL));
    KILN_TRY(append_coordinates(m, part, KILN_SECTION_TEXCOORD_GLOSS));
    uint32_t *materials = KILN_BUILDER_DATA(m->builder, uint32_t, KILN_SECTION_TRIANGLE_MATERIALS) + triangles;
    for (size_t t = 0; t < part->scene->triangle_count; t++)
        materials[t] += (uint32_t)part->materials;
    KILN_TRY(append_meshes(m, part, vertices, triangles));
end:
    return status;
}

/* Reserves memory for what takes most of it. */
static int reserve(struct kiln_merger *m)
{
    static const enum kiln_scene_section large[] = {
        KILN_SECTION_TEXELS,        KILN_SECTION_POSITIONS,         KILN_SECTION_NORMALS,
        KILN_SECTION_TEXCOORD_BASE, KILN_SECTION_TEXCOORD_EMISSION, KILN_SECTION_TEXCOORD_LIGHTMAP,
        KILN_SECTION_COLORS,        KILN_SECTION_TRIANGLES,         KILN_SECTION_TRIANGLE_MATERIALS};
    int status = KILN_OK;
    for (size_t s = 0; status == KILN_OK && s < sizeof large / sizeof *large; s++) {
        size_t sum = 0;
        for (size_t i = 0; i < m->count; i++)
            sum += (size_t)m->parts[i].scene->header->sections[large[s]].count;
        status = kiln_builder_reserve(m->builder, large[s], sum, m->error);
    }
    return status;
}

static int append_strings(struct kiln_merger *m, struct kiln_open_part *part)
{
    const uint64_t more = part->scene->header->sections[KILN_SECTION_STRINGS].count;
    if (m->builder->sections[KILN_SECTION_STRINGS].count + more >= UINT32_MAX)
        return kiln_fail(m->error, KILN_BAD_INPUT, "the names in the scene take more than 4 GiB: shorten them");
    return append(m, part, KILN_SECTION_STRINGS, &part->strings);
}

int kiln_parts_append(struct kiln_merger *m)
{
    int status;
    KILN_TRY(reserve(m));
    for (size_t i = 0; i < m->count; i++) {
        struct kiln_open_part *part = &m->parts[i];
        KILN_TRY(append_strings(m, part));
        KILN_TRY(append_textures(m, part));
        KILN_TRY(append_materials(m, part));
        KILN_TRY(append_normal_maps(m, part));
        KILN_TRY(append_glosses(m, part));
    }
    for (size_t i = 0; i < m->count; i++) /* after all materials, which tell what coordinates there are */
        KILN_TRY(append_geometry(m, &m->parts[i]));
end:
    return status;
}

/* ---- places ---- */

/* Maps a unit vector, and keeps its length to the last bit where the map keeps or doubles lengths. */
static void turn(const double at[12], const float from[3], float to[3])
{
    const struct kiln_dvec3 v = dvec3((double)from[0], (double)from[1], (double)from[2]);
    const struct kiln_dvec3 image =
        dvec3(at[0] * v.x + at[1] * v.y + at[2] * v.z, at[4] * v.x + at[5] * v.y + at[6] * v.z,
              at[8] * v.x + at[9] * v.y + at[10] * v.z);
    const struct kiln_vec3 unit = vec3_of(dvec3_scale(image, dvec3_length(v) / dvec3_length(image)));
    memcpy(to, &unit, sizeof unit);
}

static void move(const double at[12], const double from[3], double to[3])
{
    for (int r = 0; r < 3; r++)
        to[r] = at[4 * r] * from[0] + at[4 * r + 1] * from[1] + at[4 * r + 2] * from[2] + at[4 * r + 3];
}

static struct kiln_object_settings settings_of(const struct kiln_merger *m, const struct kiln_open_part *part, size_t i)
{
    const struct kiln_object *o = &part->scene->objects[i];
    struct kiln_object_settings s = part->scene->object_settings[i];
    const char *name = kiln_lod_name(s.lod_name != 0 ? string(part, s.lod_name) : NULL, string(part, o->original_name),
                                     string(part, part->scene->meshes[o->mesh].name));
    s.lod_name = (uint32_t)(part->strings + (size_t)(name - part->scene->strings));
    s.lod_member += s.lod_member != 0 ? m->members : 0;
    s.lod_group += s.lod_group != 0 ? m->groups : 0;
    return s;
}

static int add_object(struct kiln_merger *m, const struct kiln_open_part *part, size_t place, const double at[12],
                      size_t i, uint64_t *skipped)
{
    const struct kiln_object *o = &part->scene->objects[i];
    const char *original = string(part, o->original_name), *name = string(part, o->name);
    char safe[KILN_PART_NAME + 256], where[KILN_PART_NAME + 16];
    double world[12];
    bool left_out = false;
    int status = compose_name(m, part, place, name);
    if (status != KILN_OK)
        return status;
    (void)snprintf(safe, sizeof safe, "%s", m->text);
    (void)snprintf(where, sizeof where, "part '%s'", part->name);
    kiln_affine_multiply(at, o->transform, world);
    status = compose_name(m, part, place, original[0] != '\0' ? original : name);
    if (status == KILN_OK)
        status = kiln_object_add(m->builder, (uint32_t)part->meshes + o->mesh, world, safe, m->text, NULL, where,
                                 &left_out, m->error);
    if (status == KILN_OK && !left_out)
        m->builder->object_settings[m->builder->sections[KILN_SECTION_OBJECTS].count - 1] = settings_of(m, part, i);
    *skipped += left_out;
    return status;
}

static int add_lights(struct kiln_merger *m, const struct kiln_open_part *part, size_t place, const double at[12])
{
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < part->scene->light_count; i++) {
        struct kiln_light light = part->scene->lights[i];
        status = add_name(m, part, place, &light.name);
        move(at, part->scene->lights[i].position, light.position);
        turn(at, part->scene->lights[i].direction, light.direction);
        if (status == KILN_OK)
            status = kiln_builder_append(m->builder, KILN_SECTION_LIGHTS, &light, 1, NULL, m->error);
    }
    return status;
}

static int add_cameras(struct kiln_merger *m, const struct kiln_open_part *part, size_t place, const double at[12])
{
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < part->scene->camera_count; i++) {
        const struct kiln_camera *own = &part->scene->cameras[i];
        struct kiln_camera camera = *own;
        status = add_name(m, part, place, &camera.name);
        move(at, own->position, camera.position);
        turn(at, own->forward, camera.forward);
        turn(at, own->up, camera.up);
        turn(at, own->right, camera.right);
        if (status == KILN_OK)
            status = kiln_builder_append(m->builder, KILN_SECTION_CAMERAS, &camera, 1, NULL, m->error);
    }
    return status;
}

/* Takes the numbers of levels of detail of one place, so that the next one has others. */
static void count_levels(struct kiln_merger *m, const struct kiln_open_part *part)
{
    uint32_t members = 0, groups = 0;
    for (size_t i = 0; i < part->scene->object_count; i++) {
        const struct kiln_object_settings *s = &part->scene->object_settings[i];
        members = s->lod_member > members ? s->lod_member : members;
        groups = s->lod_group > groups ? s->lod_group : groups;
    }
    m->members += members;
    m->groups += groups;
}

static int place_part(struct kiln_merger *m, const struct kiln_open_part *part, uint64_t *skipped)
{
    const size_t places = json_array_size(part->places);
    int status = KILN_OK;
    for (size_t k = 0; status == KILN_OK && k < places; k++) {
        double at[12];
        for (size_t i = 0; i < 12; i++)
            at[i] = json_number_value(json_array_get(json_array_get(part->places, k), i));
        for (size_t i = 0; status == KILN_OK && i < part->scene->object_count; i++)
            status = add_object(m, part, k, at, i, skipped);
        if (status == KILN_OK)
            status = add_lights(m, part, k, at);
        if (status == KILN_OK)
            status = add_cameras(m, part, k, at);
        count_levels(m, part);
    }
    return status;
}

int kiln_parts_place(struct kiln_merger *m)
{
    uint64_t skipped = 0;
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < m->count; i++)
        status = place_part(m, &m->parts[i], &skipped);
    if (status == KILN_OK && skipped > 0)
        status = kiln_builder_note(m->builder, KILN_NOTE_REPEATED, m->error,
                                   "%llu objects are scaled to nothing by the places of parts and were left out",
                                   (unsigned long long)skipped);
    return status;
}
