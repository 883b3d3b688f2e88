#include "coordinator/bake/identity/transport_identity.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "coordinator/files/checksummed_json.h"
#include "coordinator/files/folder.h"
#include "coordinator/job/changes.h"
#include "coordinator/job/options.h"
#include "coordinator/output/read/results.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"
#include "worker/scene/gloss.h"

/* Aspects of an object, the most significant difference first. */
static const struct {
    const char *key, *text;
} aspects[] = {{"shape", "another shape"},
               {"place", "moved"},
               {"layout", "another lightmap layout or size"},
               {"sides", "other sides, holes or roles"},
               {"gloss", "other gloss or colour of a surface that rays go on from"}};
enum { ASPECTS = sizeof aspects / sizeof *aspects, SHAPE = 0, PLACE, LAYOUT, SIDES, GLOSS, ROWS_MAX = 12 };

struct hashes {
    uint64_t of[ASPECTS];
};

static uint64_t add(uint64_t hash, const void *data, size_t bytes) { return XXH3_64bits_withSeed(data, bytes, hash); }

/* ---- sides and holes ---- */

/* Hashes all alpha values of the material's texture. */
static uint64_t add_alpha(uint64_t hash, const struct kiln_scene *scene, uint32_t texture)
{
    enum { AT_ONCE = 4096 };
    if (texture == KILN_NONE)
        return hash;
    const struct kiln_texture *t = &scene->textures[texture];
    const uint32_t shape[] = {t->width, t->height, t->wrap_u, t->wrap_v, t->nearest};
    const size_t texels = (size_t)t->width * t->height;
    uint8_t alpha[AT_ONCE];
    hash = add(hash, shape, sizeof shape);
    for (size_t first = 0; first < texels; first += AT_ONCE) {
        const size_t count = texels - first < AT_ONCE ? texels - first : AT_ONCE;
        for (size_t i = 0; i < count; i++)
            alpha[i] = scene->texels[t->first + 4 * (first + i) + 3];
        hash = add(hash, alpha, count);
    }
    return hash;
}

/* Hashes the properties of a material that decide whether a ray hits it, and on which sides. */
static uint64_t side_of(const struct kiln_scene *scene, const struct kiln_material *m)
{
    const uint32_t words[] = {m->double_sided, m->alpha_mode};
    uint64_t hash = add(0, words, sizeof words);
    hash = add(hash, &m->transmission, sizeof m->transmission);
    if (m->alpha_mode == KILN_ALPHA_OPAQUE)
        return hash;
    hash = add(hash, &m->alpha_cutoff, sizeof m->alpha_cutoff);
    hash = add(hash, &m->base_color[3], sizeof m->base_color[3]);
    return add_alpha(hash, scene, m->base_color_texture);
}

static uint64_t add_sides(const struct kiln_scene *scene, const struct kiln_mesh *mesh, const uint64_t *side)
{
    bool opaque = true;
    uint64_t hash = 0;
    for (uint64_t t = mesh->triangle_first; t < mesh->triangle_first + mesh->triangle_count; t++) {
        const uint32_t material = scene->triangle_materials[t];
        hash = add(hash, &side[material], sizeof side[material]);
        opaque = opaque && scene->materials[material].alpha_mode == KILN_ALPHA_OPAQUE;
    }
    if (opaque)
        return hash;
    hash = add(hash, scene->texcoord_base + mesh->vertex_first, mesh->vertex_count * sizeof *scene->texcoord_base);
    for (uint64_t v = mesh->vertex_first; v < mesh->vertex_first + mesh->vertex_count; v++)
        hash = add(hash, &scene->colors[4 * v + 3], 1);
    return hash;
}

/* ---- gloss ---- */

static uint64_t add_texture(uint64_t hash, const struct kiln_scene *scene, uint32_t texture)
{
    if (texture == KILN_NONE)
        return hash;
    const struct kiln_texture *t = &scene->textures[texture];
    const uint32_t shape[] = {t->width, t->height, t->srgb, t->wrap_u, t->wrap_v, t->nearest};
    hash = add(hash, shape, sizeof shape);
    return add(hash, scene->texels + t->first, 4 * (size_t)t->width * t->height);
}

static bool is_gone_on_from(const struct kiln_scene *scene, uint32_t material)
{
    const struct kiln_material *m = &scene->materials[material];
    return kiln_gloss_taken(scene, material) != NULL || m->transmission > 0.0f || m->alpha_mode != KILN_ALPHA_OPAQUE;
}

/* Hashes the properties of a material that decide where a ray goes on to and how much light it brings. 0: rays end at
 * the material. */
static uint64_t gloss_of(const struct kiln_scene *scene, uint32_t material)
{
    const struct kiln_material *m = &scene->materials[material];
    const struct kiln_gloss *gloss = kiln_gloss_taken(scene, material);
    if (!is_gone_on_from(scene, material))
        return 0;
    uint64_t hash = add(1, m->base_color, sizeof m->base_color);
    hash = add(hash, &m->transmission, sizeof m->transmission);
    hash = add_texture(hash, scene, m->base_color_texture);
    if (scene->panes != NULL)
        hash = add(hash, &scene->panes[material], sizeof *scene->panes);
    if (gloss == NULL)
        return hash;
    struct kiln_gloss own = *gloss; /* textures are hashed by their content, not by their index */
    for (int i = 0; i < KILN_GLOSS_USES; i++) {
        hash = add_texture(hash, scene, own.textures[i].texture);
        own.textures[i].texture = own.textures[i].texture != KILN_NONE;
    }
    own.material = 0;
    return add(hash, &own, sizeof own);
}

/* 0: no ray goes on from the mesh. */
static uint64_t add_gloss(const struct kiln_scene *scene, const struct kiln_mesh *mesh, const uint64_t *gloss)
{
    bool any = false;
    uint64_t hash = 0;
    for (uint64_t t = mesh->triangle_first; t < mesh->triangle_first + mesh->triangle_count; t++) {
        const uint64_t of = gloss[scene->triangle_materials[t]];
        hash = add(hash, &of, sizeof of);
        any = any || of != 0;
    }
    if (!any)
        return 0;
    hash = add(hash, scene->texcoord_base + mesh->vertex_first, mesh->vertex_count * sizeof *scene->texcoord_base);
    if (scene->texcoord_gloss != NULL)
        hash =
            add(hash, scene->texcoord_gloss + mesh->vertex_first, mesh->vertex_count * sizeof *scene->texcoord_gloss);
    return add(hash, scene->colors + 4 * mesh->vertex_first, 4 * mesh->vertex_count);
}

/* ---- objects ---- */

static void hash_mesh(const struct kiln_scene *s, const struct kiln_mesh *m, const uint64_t *side,
                      const uint64_t *gloss, struct hashes *h)
{
    h->of[GLOSS] = add_gloss(s, m, gloss);
    h->of[SHAPE] = add(0, s->positions + m->vertex_first, m->vertex_count * sizeof *s->positions);
    h->of[SHAPE] = add(h->of[SHAPE], s->normals + m->vertex_first, m->vertex_count * sizeof *s->normals);
    h->of[SHAPE] = add(h->of[SHAPE], s->triangles + 3 * m->triangle_first, m->triangle_count * 3 * sizeof(uint32_t));
    h->of[LAYOUT] = add(0, s->texcoord_lightmap + m->vertex_first, m->vertex_count * sizeof *s->texcoord_lightmap);
    h->of[SIDES] = add_sides(s, m, side);
}

/* Describes an object by its hashes. `two_sided`: hash of its triangles whose backs count. Backs of a solid count only
 * if they emit. */
static json_t *object_json(const struct kiln_object *o, const struct hashes *mesh, uint64_t two_sided)
{
    struct hashes h = *mesh;
    const uint32_t size[] = {o->lightmap_width, o->lightmap_height};
    json_t *json = json_object();
    h.of[PLACE] = add(add(0, o->transform, sizeof o->transform), &o->flipped, sizeof o->flipped);
    h.of[LAYOUT] = add(h.of[LAYOUT], size, sizeof size);
    h.of[SIDES] = add(add(h.of[SIDES], &o->flags, sizeof o->flags), &two_sided, sizeof two_sided);
    for (int i = 0; i < ASPECTS; i++) {
        char text[17];
        (void)snprintf(text, sizeof text, "%016llx", (unsigned long long)h.of[i]);
        (void)json_object_set_new(json, aspects[i].key, json_string(text));
    }
    return json;
}

static json_t *objects_json(const struct kiln_scene *s, const struct kiln_geometry *g)
{
    const bool passes = g->passage >= KILN_PASSAGE_TINT;
    struct kiln_arena arena = {0};
    uint64_t *side = NULL, *gloss = NULL, *two_sided = NULL;
    struct hashes *meshes = NULL;
    json_t *objects = NULL;
    if (kiln_arena_allocate(&arena, &side, s->material_count, sizeof *side, "materials", NULL) == KILN_OK &&
        kiln_arena_allocate(&arena, &gloss, s->material_count, sizeof *gloss, "materials", NULL) == KILN_OK &&
        kiln_arena_allocate(&arena, &meshes, s->mesh_count, sizeof *meshes, "meshes", NULL) == KILN_OK &&
        kiln_arena_allocate(&arena, &two_sided, s->object_count, sizeof *two_sided, "objects", NULL) == KILN_OK)
        objects = json_object();
    for (size_t i = 0; objects != NULL && i < s->material_count; i++) {
        side[i] = side_of(s, &s->materials[i]);
        gloss[i] = passes || s->taken != NULL ? gloss_of(s, (uint32_t)i) : 0;
    }
    for (size_t i = 0; objects != NULL && i < s->mesh_count; i++)
        hash_mesh(s, &s->meshes[i], side, gloss, &meshes[i]);
    for (size_t i = 0; objects != NULL && i < g->triangle_count; i++)
        two_sided[g->records[i].object] += (g->records[i].material & KILN_RECORD_DOUBLE_SIDED) != 0;
    for (size_t i = 0; objects != NULL && i < s->object_count; i++)
        (void)json_object_set_new(objects, kiln_scene_string(s, s->objects[i].name),
                                  object_json(&s->objects[i], &meshes[s->objects[i].mesh], two_sided[i]));
    kiln_arena_release(&arena);
    return objects;
}

bool kiln_transport_goes_on(const struct kiln_job *job, const struct kiln_prepared *p)
{
    return (kiln_job_takes_gloss(job) && p->scene->taken != NULL) || p->geometry->passage >= KILN_PASSAGE_TINT;
}

bool kiln_transport_keeps_colour(const struct kiln_job *job, const struct kiln_prepared *p, uint32_t material)
{
    return kiln_transport_goes_on(job, p) && is_gone_on_from(p->scene, material);
}

json_t *kiln_transport_identity(const struct kiln_job *job, const struct kiln_prepared *p)
{
    const double *centre = p->scene->header->centre;
    json_t *objects = objects_json(p->scene, p->geometry);
    return objects == NULL
               ? NULL
               : json_pack("{s:I, s:I, s:I, s:I, s:[f,f,f], s:f, s:s, s:s, s:o}", "seed", (json_int_t)job->light.seed,
                           "chain_length", (json_int_t)(p->scene->taken != NULL ? job->light.chain_length : 0),
                           "points", (json_int_t)p->surface->point_count, "cells",
                           (json_int_t)p->surface_report.cells_total, "centre", centre[0], centre[1], centre[2],
                           "cell_size", p->surface_report.cell_size, "store",
                           p->surface->bricks != NULL ? "octree" : "lightmap", "partition",
                           job->ranks.partition_objects ? "objects" : "cells", "objects", objects);
}

uint64_t kiln_transport_key(const json_t *identity)
{
    char *text = json_dumps(identity, JSON_COMPACT | JSON_SORT_KEYS);
    const uint64_t key = text != NULL ? XXH3_64bits(text, strlen(text)) : 0;
    free(text);
    return key;
}

/* ---- the index ---- */

/* Reads the text of the index. For a finished bake it must be as the manifest lists it. */
static int read_text(const char *directory, char path[KILN_PATH_SIZE], char **text, size_t *size,
                     struct kiln_error *error)
{
    enum { MOST = 1 << 30 };
    static const char name[] = "transport/index";
    struct kiln_results *results = NULL;
    int status;
    KILN_TRY(kiln_path_join(path, directory, name, error));
    KILN_TRY(kiln_results_open(&results, directory, error));
    KILN_TRY(kiln_results_bytes(results, name, MOST, text, size, error));
end:
    kiln_results_close(&results);
    return status;
}

static bool are_texts(const json_t *values)
{
    const char *name;
    json_t *value;
    bool good = json_is_object(values);
    json_object_foreach((json_t *)(uintptr_t)values, name, value) good = good && json_is_string(value);
    return good;
}

/* Whether the index has all members that kiln writes, each of the right type. */
static bool is_index(const json_t *index)
{
    static const char *const texts[] = {"kiln", "scene", "backend", "instruction set"};
    static const char *const optional[] = {"changes", "light groups"};
    bool good = json_is_object(json_object_get(json_object_get(index, "identity"), "objects"));
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++)
        good = good && json_is_string(json_object_get(index, texts[i]));
    for (size_t i = 0; i < sizeof optional / sizeof *optional; i++) {
        const json_t *value = json_object_get(index, optional[i]);
        good = good && (value == NULL || json_is_object(value));
    }
    const json_t *parts = json_object_get(index, "parts");
    return good && (parts == NULL || json_is_array(parts)) && are_texts(json_object_get(index, "job"));
}

int kiln_transport_index_read(json_t **index, const char *directory, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], *text = NULL;
    size_t size = 0;
    *index = NULL;
    int status = read_text(directory, path, &text, &size, error);
    if (status == KILN_NO_INPUT)
        status = kiln_fail(error, KILN_NO_INPUT,
                           "the bake in %.500s has kept no transport, or is not finished: bake it with "
                           "--keep-transport rows",
                           directory);
    if (status == KILN_OK)
        status = kiln_unseal(index, text, size, path, error);
    if (status == KILN_OK && !is_index(*index))
        status = kiln_fail(error, KILN_BAD_INPUT,
                           "'%.500s' is no index of kept transport: values are missing, or are of another type; bake "
                           "again with --keep-transport rows",
                           path);
    kiln_free(&text);
    if (status != KILN_OK) {
        json_decref(*index);
        *index = NULL;
    }
    return status;
}

/* ---- options ---- */

static int take_option(struct kiln_job *job, const struct kiln_option *option, const json_t *value,
                       const char *directory, struct kiln_error *error)
{
    char where[KILN_OPTION_TEXT + 80];
    (void)snprintf(where, sizeof where, "%s, of the bake in %.60s", option->name, directory);
    return kiln_job_given(job, option)
               ? KILN_OK
               : kiln_option_set(job, option, json_string_value(value), where, KILN_BAD_INPUT, NULL, error);
}

/* Takes changes or light groups from the index itself. The file they were read from may have changed since. */
static int take_rules(struct kiln_job *job, const json_t *rules, const char *directory, const char *what, char **to,
                      struct kiln_error *error)
{
    char where[200], *given = json_dumps(rules, JSON_COMPACT), *text = NULL;
    (void)snprintf(where, sizeof where, "%s of the bake in %.100s", what, directory);
    int status = given == NULL ? kiln_fail(error, KILN_SYSTEM, "out of memory: the index of the transport")
                               : kiln_changes_line(given, strlen(given), where, &text, error);
    if (status == KILN_OK)
        status = kiln_job_keep_text(job, text, to, error);
    free(given);
    free(text);
    return status;
}

/* An index that names a file is of an earlier kiln. Files that a folder names are not followed. */
static int refuse_file(const json_t *options, const char *name, const char *directory, const char *remedy,
                       struct kiln_error *error)
{
    return json_object_get(options, name) == NULL
               ? KILN_OK
               : kiln_fail(error, KILN_BAD_INPUT, "the bake in %.300s names a file of %s, which is not followed: %s",
                           directory, name, remedy);
}

int kiln_transport_options_take(struct kiln_job *job, const json_t *index, const char *directory,
                                struct kiln_error *error)
{
    const json_t *options = json_object_get(index, "job");
    const struct kiln_option *backend = kiln_option_find_for("backend", KILN_FOR_BAKE),
                             *set = kiln_option_find_for("instruction-set", KILN_FOR_BAKE);
    int status = KILN_OK;
    for (size_t i = 0; i < kiln_option_count; i++) {
        const struct kiln_option *option = &kiln_options[i];
        const json_t *value = json_object_get(options, option->name);
        if (value != NULL && option->of_light && (option->commands & KILN_FOR_BAKE) != 0)
            KILN_TRY(take_option(job, option, value, directory, error));
    }
    /* those whose bits the bake has */
    KILN_TRY(take_option(job, backend, json_object_get(index, "backend"), directory, error));
    KILN_TRY(take_option(job, set, json_object_get(index, "instruction set"), directory, error));
    KILN_TRY(kiln_job_settle_light(job, error));
end:
    return status;
}

int kiln_transport_scene_take(struct kiln_job *job, const json_t *index, const char *directory,
                              struct kiln_error *error)
{
    const json_t *parts = json_object_get(index, "parts");
    char where[400];
    (void)snprintf(where, sizeof where, "%.300s/transport/index", directory);
    const int status = parts == NULL ? KILN_OK : kiln_job_parts_read(job, parts, where, error);
    return status != KILN_OK
               ? status
               : kiln_job_keep_text(job, json_string_value(json_object_get(index, "scene")), &job->scene.file, error);
}

int kiln_transport_changes_take(struct kiln_job *job, const json_t *index, const char *directory,
                                struct kiln_error *error)
{
    const json_t *changes = json_object_get(index, "changes");
    const int status = refuse_file(json_object_get(index, "job"), "changes", directory,
                                   "give it after the folder, or the scene without changes", error);
    return status != KILN_OK || changes == NULL
               ? status
               : take_rules(job, changes, directory, "changes", &job->scene.changed, error);
}

int kiln_transport_groups_take(struct kiln_job *job, const json_t *index, const char *directory,
                               struct kiln_error *error)
{
    const json_t *groups = json_object_get(index, "light groups");
    const int status =
        refuse_file(json_object_get(index, "job"), "light-groups", directory, "give --light-groups FILE", error);
    return status != KILN_OK || groups == NULL
               ? status
               : take_rules(job, groups, directory, "groups of lights", &job->scene.grouped, error);
}

/* ---- comparison ---- */

/* A table of what differs; rows beyond ROWS_MAX are only counted. */
struct table {
    char text[1500];
    size_t count;
};

static void add_row(struct table *table, const char *name, const char *what)
{
    char cell[61];
    const size_t used = strlen(table->text);
    if (table->count++ < ROWS_MAX)
        (void)snprintf(table->text + used, sizeof table->text - used, "\n  %-32s %s",
                       kiln_text_plain(cell, sizeof cell, name), what);
}

static void compare_object(struct table *table, const char *name, const json_t *then, const json_t *now)
{
    for (int i = 0; i < ASPECTS; i++)
        if (json_equal(json_object_get(then, aspects[i].key), json_object_get(now, aspects[i].key)) == 0)
            add_row(table, name, aspects[i].text);
}

int kiln_transport_compare(const json_t *then, const json_t *now, const char *directory, struct kiln_error *error)
{
    struct table table = {"", 0};
    const json_t *before = json_object_get(then, "objects"), *after = json_object_get(now, "objects");
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)(uintptr_t)after, key, value)
    {
        const json_t *old = json_object_get(before, key);
        if (old == NULL)
            add_row(&table, key, "new");
        else
            compare_object(&table, key, old, value);
    }
    json_object_foreach((json_t *)(uintptr_t)before, key, value) if (json_object_get(after, key) == NULL)
        add_row(&table, key, "gone");
    if (table.count == 0 && json_equal(then, now) != 0)
        return KILN_OK;
    if (table.count == 0)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "what rays meet, as %.300s/transport has it, is of another surface: its points, cells or seed "
                         "differ; bake the scene again",
                         directory);
    if (table.count > ROWS_MAX) {
        const size_t used = strlen(table.text);
        (void)snprintf(table.text + used, sizeof table.text - used, "\n  and %zu more", table.count - ROWS_MAX);
    }
    return kiln_fail_table(error, KILN_BAD_INPUT, table.text,
                           "the scene has other geometry than the bake in %.300s: only lights, colours and sky may "
                           "change; bake the scene again, or put these objects back",
                           directory);
}
