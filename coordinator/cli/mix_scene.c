#include "coordinator/cli/mix_scene.h"

#include <float.h>
#include <fnmatch.h>
#include <math.h>
#include <string.h>

#include "coordinator/files/publish.h"
#include "worker/base/memory.h"
#include "worker/scene/scene.h"

struct mixing {
    const struct kiln_scene *scene;
    const json_t *rules; /* rules of groups, by name (coordinator/job/light_groups.h); NULL: only patches of the sky */
    const struct kiln_mix_factors *factors;
    json_t *as_baked;
    uint8_t *bytes; /* of the new file */
};

/* Common factor of something that may be in several groups. */
struct factor {
    double of[3];
    bool known, differs; /* known: at least one group has it; differs: two groups have different factors */
};

static void join(struct factor *f, const double one[3])
{
    f->differs = f->differs || (f->known && memcmp(f->of, one, sizeof f->of) != 0);
    f->known = true;
    memcpy(f->of, one, sizeof f->of);
}

/* Combines the factors of a group, or of all its blocks NAME.X.Y; for "sky", those of all patches. */
static void join_group(const struct mixing *m, const char *name, struct factor *f)
{
    const size_t length = strlen(name);
    for (size_t g = 0; g < m->factors->count; g++) {
        const char *own = m->factors->names[g];
        if (strncmp(own, name, length) == 0 && (own[length] == '\0' || own[length] == '.'))
            join(f, m->factors->of[g]);
    }
}

/* Whether each patch of the sky has a light group of its own (--sky-patches). */
static bool has_patches(const struct mixing *m)
{
    for (size_t g = 0; g < m->factors->count; g++)
        if (strcmp(m->factors->names[g], "sky.ground") == 0)
            return true;
    return false;
}

/* Whether a rule has the name in its list `key`; without a name, whether it includes the environment. */
static bool has(const json_t *rule, const char *key, const char *name)
{
    const json_t *list = json_object_get(rule, key), *pattern;
    size_t i;
    if (name == NULL)
        return json_is_true(list);
    json_array_foreach(list, i, pattern) if (json_is_string(pattern) &&
                                             fnmatch(json_string_value(pattern), name, 0) == 0) return true;
    return false;
}

/* Returns the factor of `name` by the rules' list `key`; NULL: of the environment. If no rule names it, a material may
 * be in a group by its object, and all else is in the rest. */
static struct factor find_factor(const struct mixing *m, const char *key, const char *name)
{
    const bool material = strcmp(key, "materials") == 0;
    struct factor f = {.known = false};
    const char *group;
    json_t *rule;
    json_object_foreach((json_t *)(uintptr_t)m->rules, group, rule) if (has(rule, key, name)) join_group(m, group, &f);
    if (name == NULL && !f.known && has_patches(m))
        join_group(m, "sky", &f);
    if (!f.known)
        join_group(m, "rest", &f);
    json_object_foreach((json_t *)(uintptr_t)m->rules, group, rule)
    {
        if (material && json_object_get(rule, "objects") != NULL)
            join_group(m, group, &f);
    }
    return f;
}

/* Multiplies a colour of the new scene file by its factor, if it has a single one. */
static void scale(const struct mixing *m, const char *key, const char *name, float color[3])
{
    const struct factor f = find_factor(m, key, name);
    if (!(color[0] > 0.0f || color[1] > 0.0f || color[2] > 0.0f))
        return;
    if (f.differs)
        (void)json_array_append_new(m->as_baked, json_string(name != NULL ? name : "environment"));
    for (int c = 0; c < 3 && f.known && !f.differs; c++)
        color[c] = (float)fmin((double)color[c] * f.of[c], (double)FLT_MAX);
}

static void *section(const struct mixing *m, enum kiln_scene_section which)
{
    return m->bytes + m->scene->header->sections[which].offset;
}

static void mix(const struct mixing *m)
{
    struct kiln_material *materials = section(m, KILN_SECTION_MATERIALS);
    struct kiln_light *lights = section(m, KILN_SECTION_LIGHTS);
    struct kiln_environment *environment = section(m, KILN_SECTION_ENVIRONMENT);
    for (size_t i = 0; i < m->scene->material_count; i++)
        scale(m, "materials", kiln_scene_string(m->scene, materials[i].name), materials[i].emission);
    for (size_t i = 0; i < m->scene->light_count; i++)
        scale(m, "lights", kiln_scene_string(m->scene, lights[i].name), lights[i].intensity);
    if (environment->kind != KILN_ENVIRONMENT_NONE)
        scale(m, "environment", NULL, environment->radiance);
}

int kiln_mix_scene_write(const char *directory, const struct kiln_results *results, const json_t *run,
                         const struct kiln_mix_factors *factors, json_t *as_baked, struct kiln_error *error)
{
    struct kiln_scene *scene = NULL;
    struct mixing m = {.rules = json_object_get(run, "light_group_rules"), .factors = factors, .as_baked = as_baked};
    int status;
    KILN_TRY(kiln_results_scene(results, &scene, error));
    KILN_TRY(kiln_allocate(&m.bytes, scene->mapped_bytes, 1, "the scene", error));
    struct kiln_scene_header header = *scene->header;
    m.scene = scene;
    memcpy(m.bytes, scene->mapped, scene->mapped_bytes);
    if (m.rules != NULL || has_patches(&m)) /* bakes of earlier versions do not list their groups' rules */
        mix(&m);
    kiln_scene_content_hash(&header, m.bytes + kiln_scene_header_bytes(header.version), header.content_hash);
    memcpy(m.bytes + offsetof(struct kiln_scene_header, content_hash), header.content_hash, sizeof header.content_hash);
    KILN_TRY(kiln_publish_bytes_below(directory, "scene.kscene", m.bytes, scene->mapped_bytes, error));
end:
    kiln_free(&m.bytes);
    kiln_scene_close(&scene);
    return status;
}
