/* Finds the group of each light of the scene (coordinator/job/light_groups.h). */
#include <fnmatch.h>
#include <jansson.h>
#include <math.h>
#include <string.h>

#include "coordinator/bake/bake_private.h"
#include "coordinator/job/light_groups.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

/* The rules of light groups, and the scene whose names they match. */
struct rules {
    const struct kiln_scene *scene;
    json_t *groups;
    uint32_t count;
};

/* Returns the index of the first block of group `wanted`. `blocks` receives its blocks along x and y; 0 and 0: the
 * group is not cut into blocks. */
static uint32_t first_of(json_t *groups, uint32_t wanted, uint32_t blocks[2])
{
    const char *name;
    json_t *rules;
    uint32_t first = 0, at = 0;
    blocks[0] = blocks[1] = 0;
    json_object_foreach(groups, name, rules)
    {
        uint32_t size[2];
        kiln_job_group_blocks(rules, size);
        if (at++ == wanted && json_object_get(rules, "blocks") != NULL)
            memcpy(blocks, size, sizeof size);
        if (at > wanted)
            break;
        first += size[0] * size[1];
    }
    return first;
}

/* The group, counted as the file has them, whose list `key` has a pattern for the name; KILN_NONE: none. KILN_NONE - 1:
 * two have. */
static uint32_t group_of(const struct rules *r, const char *key, uint32_t name)
{
    const char *text = kiln_scene_string(r->scene, name), *group_name;
    uint32_t found = KILN_NONE, group = 0;
    json_t *group_rules, *pattern;
    size_t i;
    json_object_foreach(r->groups, group_name, group_rules)
    {
        bool matches = false;
        json_array_foreach(json_object_get(group_rules, key), i, pattern) matches =
            matches || fnmatch(json_string_value(pattern), text, 0) == 0;
        if (matches)
            found = found == KILN_NONE ? group : KILN_NONE - 1;
        group++;
    }
    return found;
}

/* Finds the one group that the patterns for materials and objects agree on, or the rest, and the blocks that it is cut
 * into (0: none). */
static int settle(const struct rules *r, const uint32_t found[2], const char *what, uint32_t name, uint32_t *group,
                  uint32_t blocks[2], struct kiln_error *error)
{
    const bool both = found[0] != KILN_NONE && found[1] != KILN_NONE && found[0] != found[1];
    if (both || found[0] == KILN_NONE - 1 || found[1] == KILN_NONE - 1)
        return kiln_fail(error, KILN_USAGE, "--light-groups: the %s '%.200s' is in two groups; name it in one", what,
                         kiln_scene_string(r->scene, name));
    const uint32_t of_file = found[0] != KILN_NONE ? found[0] : found[1];
    *group = of_file != KILN_NONE ? first_of(r->groups, of_file, blocks) : r->count - 1;
    return KILN_OK;
}

/* Finds the texture coordinates of the corners of an emitting triangle, or of one of its parts. */
static void corners_of(const struct rules *r, const struct kiln_lights *l, size_t area, double uv[3][2])
{
    const uint32_t triangle = l->areas[area].triangle;
    const struct kiln_object *object = &r->scene->objects[l->geometry->records[triangle].object];
    const struct kiln_mesh *mesh = &r->scene->meshes[object->mesh];
    const uint32_t *corners = r->scene->triangles + 3 * (size_t)l->geometry->stored_triangle[triangle];
    struct kiln_vec2 at[3];
    for (uint32_t k = 0; k < 3; k++) {
        const uint32_t stored = object->flipped && k > 0 ? 3 - k : k;
        at[k] = r->scene->texcoord_emission[mesh->vertex_first + corners[stored]];
    }
    for (int k = 0; k < 3; k++) { /* corners of the part, if the triangle is divided */
        const double b1 = (double)l->areas[area].at[k][0], b2 = (double)l->areas[area].at[k][1];
        uv[k][0] = (double)at[0].x + b1 * (double)(at[1].x - at[0].x) + b2 * (double)(at[2].x - at[0].x);
        uv[k][1] = (double)at[0].y + b1 * (double)(at[1].y - at[0].y) + b2 * (double)(at[2].y - at[0].y);
    }
}

/* Finds the bounding rectangle of the texture coordinates of a group's emitting triangles. */
static void find_rectangle(const struct rules *r, const struct kiln_lights *l, const struct kiln_light_groups *g,
                           uint32_t group, double low[2], double size[2])
{
    double high[2] = {-INFINITY, -INFINITY};
    low[0] = low[1] = INFINITY;
    for (size_t i = 0; i < l->area_count; i++) {
        double uv[3][2];
        if (g->of_tree[i] != group)
            continue;
        corners_of(r, l, i, uv);
        for (int k = 0; k < 6; k++) {
            low[k % 2] = fmin(low[k % 2], uv[k / 2][k % 2]);
            high[k % 2] = fmax(high[k % 2], uv[k / 2][k % 2]);
        }
    }
    for (int a = 0; a < 2; a++)
        size[a] = high[a] - low[a];
}

/* Cuts the emitting triangles of a group into its blocks. */
static int cut(const struct rules *r, const struct kiln_lights *l, const struct kiln_light_groups *g, uint32_t group,
               struct kiln_error *error)
{
    double low[2], size[2];
    find_rectangle(r, l, g, group, low, size);
    for (size_t i = 0; i < l->area_count; i++) {
        struct kiln_light_block *b = &g->block_of[i];
        const uint32_t blocks[2] = {b->columns, b->rows};
        double uv[3][2];
        if (g->of_tree[i] != group)
            continue;
        if (!(size[0] > 0.0 && size[1] > 0.0))
            return kiln_fail(
                error, KILN_USAGE,
                "--light-groups: the object '%.200s' has no texture for its emission, by whose coordinates it "
                "could be cut into blocks; give it one, or leave blocks out",
                kiln_scene_string(r->scene, r->scene->objects[l->geometry->records[l->areas[i].triangle].object].name));
        corners_of(r, l, i, uv);
        for (int a = 0; a < 2; a++) {
            b->at[a] = (uv[0][a] - low[a]) / size[a] * blocks[a];
            for (int k = 0; k < 2; k++)
                b->along[k][a] = (uv[k + 1][a] - uv[0][a]) / size[a] * blocks[a];
        }
    }
    return KILN_OK;
}

static int sort_areas(const struct rules *r, const struct kiln_lights *l, struct kiln_light_groups *g,
                      struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < l->area_count && status == KILN_OK; i++) {
        const struct kiln_hit_record *record = &l->geometry->records[l->areas[i].triangle];
        const uint32_t object = r->scene->objects[record->object].name;
        const uint32_t found[2] = {
            group_of(r, "materials", r->scene->materials[record->material & KILN_RECORD_MATERIAL].name),
            group_of(r, "objects", object)};
        uint32_t blocks[2] = {0, 0};
        status = settle(r, found, "object", object, &g->of_tree[i], blocks, error);
        g->block_of[i].columns = blocks[0];
        g->block_of[i].rows = blocks[1];
    }
    for (uint32_t i = 0; i < json_object_size(r->groups) && status == KILN_OK; i++) {
        uint32_t blocks[2];
        const uint32_t group = first_of(r->groups, i, blocks);
        if (blocks[0] > 0)
            status = cut(r, l, g, group, error);
    }
    return status;
}

/* Assigns groups to points, spots and directional lights, in the order in which kiln_lights_create takes them. */
static int sort_punctual(const struct rules *r, const struct kiln_lights *l, struct kiln_light_groups *g,
                         struct kiln_error *error)
{
    size_t points = l->area_count, directionals = 0;
    int status = KILN_OK;
    for (size_t i = 0; i < r->scene->light_count && status == KILN_OK; i++) {
        const struct kiln_light *light = &r->scene->lights[i];
        const uint32_t found[2] = {group_of(r, "lights", light->name), KILN_NONE};
        uint32_t blocks[2];
        uint32_t *to = light->kind == KILN_LIGHT_DIRECTIONAL ? &g->of_directional[directionals] : &g->of_tree[points];
        if (kiln_luminance_of_floats(light->intensity) <= 0.0)
            continue;
        directionals += light->kind == KILN_LIGHT_DIRECTIONAL;
        points += light->kind != KILN_LIGHT_DIRECTIONAL;
        status = settle(r, found, "light", light->name, to, blocks, error);
    }
    return status;
}

static uint32_t group_of_sky(const struct rules *r)
{
    const char *name;
    json_t *rules;
    uint32_t group = 0, found = r->count - 1; /* blocks counted */
    json_object_foreach(r->groups, name, rules)
    {
        if (json_is_true(json_object_get(rules, "environment")))
            found = group;
        uint32_t size[2];
        kiln_job_group_blocks(rules, size);
        group += size[0] * size[1];
    }
    return found;
}

static bool emits(const struct kiln_material *m)
{
    return m->emission[0] > 0.0f || m->emission[1] > 0.0f || m->emission[2] > 0.0f;
}

/* Refuses a pattern for materials that matches none that emits. A relight may have turned them off. */
static int check_emission(const struct kiln_bake *b, const struct rules *r, struct kiln_error *error)
{
    const char *name;
    json_t *rules, *pattern;
    size_t i;
    json_object_foreach(r->groups, name, rules) json_array_foreach(json_object_get(rules, "materials"), i, pattern)
    {
        bool any = b->job->relighting.folder != NULL;
        for (size_t n = 0; n < r->scene->material_count && !any; n++)
            any = emits(&r->scene->materials[n]) &&
                  fnmatch(json_string_value(pattern), kiln_scene_string(r->scene, r->scene->materials[n].name), 0) == 0;
        if (!any)
            return kiln_fail(error, KILN_USAGE,
                             "--light-groups: %.300s: %s: the material '%.200s' emits no light; name one that does, or "
                             "leave it out",
                             b->job->scene.light_groups, name, json_string_value(pattern));
    }
    return KILN_OK;
}

/* Checks that each pattern matches the name of something in the scene. */
static int check_patterns(const struct rules *r, struct kiln_error *error)
{
    static const char *const keys[] = {"lights", "materials", "objects"};
    const char *name;
    json_t *rules, *pattern;
    size_t i;
    json_object_foreach(r->groups, name, rules) for (int k = 0; k < 3; k++)
        json_array_foreach(json_object_get(rules, keys[k]), i, pattern)
    {
        const size_t count = k == 0   ? r->scene->light_count
                             : k == 1 ? r->scene->material_count
                                      : r->scene->object_count;
        bool any = false;
        for (size_t n = 0; n < count && !any; n++) {
            const uint32_t of = k == 0   ? r->scene->lights[n].name
                                : k == 1 ? r->scene->materials[n].name
                                         : r->scene->objects[n].name;
            any = fnmatch(json_string_value(pattern), kiln_scene_string(r->scene, of), 0) == 0;
        }
        if (!any)
            return kiln_fail(error, KILN_USAGE, "--light-groups: %s: no name of the scene's %s matches '%.200s'", name,
                             keys[k], json_string_value(pattern));
    }
    return KILN_OK;
}

/* Why this bake cannot have groups; NULL: it can. */
static const char *why_not(const struct kiln_job *job, const struct kiln_prepared *p)
{
    if (kiln_job_is_reference(job) || kiln_job_is_radiosity(job))
        return "--method cells alone has them: leave --method out";
    if (kiln_job_takes_gloss(job) || p->geometry->passage >= KILN_PASSAGE_TINT)
        return "they are of diffuse surfaces: give --materials diffuse, and no tinted glass";
    if (kiln_job_has_probes(job) || job->light.guide > 0)
        return "leave --tracing-range and --guide out";
    if (kiln_job_parts(job) > 1 || job->light.only_visible_from != NULL ||
        job->ranks.exchange_points == KILN_EXCHANGE_VISIBLE)
        return "leave --error-map, --target-error, --only-visible-from and --exchange-points out";
    return p->surface->point_count > INT32_MAX ? "they are for up to 2^31 surface points" : NULL;
}

static int sort(struct kiln_bake *b, struct kiln_error *error)
{
    const struct kiln_lights *l = b->prepared->lights;
    struct kiln_light_groups *g = &b->groups;
    const char *why = why_not(b->job, b->prepared);
    if (why != NULL)
        return kiln_fail(error, KILN_USAGE, "--light-groups: %s", why);
    const uint32_t patches = kiln_sky_patches[b->job->scene.sky_patches];
    if (patches > 0 && b->job->relighting.folder == NULL &&
        b->prepared->scene->environment->kind == KILN_ENVIRONMENT_NONE)
        return kiln_fail(error, KILN_USAGE,
                         "--sky-patches: the scene has no sky; give --environment, or leave --sky-patches out");
    struct rules r = {b->prepared->scene,
                      json_loads(b->job->scene.grouped != NULL ? b->job->scene.grouped : "{}", 0, NULL),
                      (uint32_t)b->job->scene.group_count};
    g->count = r.count;
    g->sky_divisions = kiln_sky_divisions[b->job->scene.sky_patches];
    int status;
    KILN_TRY(kiln_allocate(&g->of_tree, l->area_count + l->point_count + 1, sizeof *g->of_tree, "groups", error));
    KILN_TRY(kiln_allocate(&g->of_directional, l->directional_count + 1, sizeof *g->of_directional, "groups", error));
    KILN_TRY(kiln_allocate(&g->block_of, l->area_count + 1, sizeof *g->block_of, "groups", error));
    KILN_TRY(check_patterns(&r, error));
    KILN_TRY(check_emission(b, &r, error));
    KILN_TRY(sort_areas(&r, l, g, error));
    KILN_TRY(sort_punctual(&r, l, g, error));
end:
    g->of_environment = patches > 0 ? r.count - 2 - patches : group_of_sky(&r); /* before the ground and the rest */
    json_decref(r.groups);
    return status;
}

int kiln_bake_groups_sort(struct kiln_bake *b, struct kiln_error *error)
{
    return b->job->scene.group_count > 0 ? kiln_agree(b->communicator, sort(b, error), error) : KILN_OK;
}

void kiln_bake_groups_release(struct kiln_bake *b)
{
    kiln_free(&b->groups.of_tree);
    kiln_free(&b->groups.of_directional);
    kiln_free(&b->groups.block_of);
}
