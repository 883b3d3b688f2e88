#include "coordinator/import/changes.h"

#include <fnmatch.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/files/publish.h"
#include "coordinator/job/options.h"
#include "worker/base/memory.h"
#include "worker/scene/scene.h"

/* Setting of a light, a material or the sky: a number, three numbers (a colour) or a switch, with its bounds. */
struct setting {
    const char *name;
    bool is_switch, is_color; /* neither: a number, or also three numbers with `either` */
    bool either;
    double least, most;
};
static const struct setting light_settings[] = {{.name = "on", .is_switch = true},
                                                {.name = "scale", .either = true, .most = KILN_LIGHT_MOST},
                                                {.name = "intensity", .is_color = true, .most = KILN_LIGHT_MOST},
                                                {.name = NULL}};
static const struct setting material_settings[] = {{.name = "on", .is_switch = true},
                                                   {.name = "emission", .is_color = true, .most = KILN_LIGHT_MOST},
                                                   {.name = "emission-scale", .either = true, .most = KILN_LIGHT_MOST},
                                                   {.name = "albedo", .is_color = true, .most = 1.0},
                                                   {.name = NULL}};
static const struct setting environment_settings[] = {{.name = "on", .is_switch = true},
                                                      {.name = "scale", .either = true, .most = KILN_LIGHT_MOST},
                                                      {.name = "radiance", .is_color = true, .most = KILN_LIGHT_MOST},
                                                      {.name = "rotation", .least = -3600.0, .most = 3600.0},
                                                      {.name = NULL}};

/* ---- values ---- */

static bool is_within(const json_t *value, const struct setting *s)
{
    const double x = json_number_value(value);
    return json_is_number(value) && isfinite(x) && x >= s->least && x <= s->most;
}

static bool is_three(const json_t *value, const struct setting *s)
{
    bool good = json_array_size(value) == 3;
    for (size_t c = 0; c < 3 && good; c++)
        good = is_within(json_array_get(value, c), s);
    return good;
}

static bool is_good(const json_t *value, const struct setting *s)
{
    if (s->is_switch)
        return json_is_boolean(value);
    return is_three(value, s) || (!s->is_color && is_within(value, s) && !json_is_array(value));
}

static int check(const char *where, const json_t *settings, const struct setting *known, struct kiln_error *error)
{
    const char *name;
    json_t *value;
    if (!json_is_object(settings))
        return kiln_fail(error, KILN_USAGE, "changes: %s needs settings, such as {%s: %s}", where, known[1].name,
                         known[1].is_color ? "[1, 1, 1]" : "2");
    json_object_foreach((json_t *)(uintptr_t)settings, name, value)
    {
        const struct setting *s = known;
        while (s->name != NULL && strcmp(s->name, name) != 0)
            s++;
        if (s->name == NULL)
            return kiln_fail(error, KILN_USAGE, "changes: %s has no setting '%.100s'; it has %s, %s, %s%s%s", where,
                             name, known[0].name, known[1].name, known[2].name, known[3].name != NULL ? ", " : "",
                             known[3].name != NULL ? known[3].name : "");
        if (!is_good(value, s) && s->is_switch)
            return kiln_fail(error, KILN_USAGE, "changes: %s: '%s' is true or false", where, name);
        if (!is_good(value, s))
            return kiln_fail(error, KILN_USAGE, "changes: %s: '%s' is %s from %g to %g", where, name,
                             s->is_color ? "three numbers, [R, G, B],"
                             : s->either ? "a number, or three, [R, G, B],"
                                         : "a number",
                             s->least, s->most);
    }
    return KILN_OK;
}

/* Reads the three numbers of a setting; a single number is repeated. Returns false if the setting is not given. */
static bool three(const json_t *settings, const char *name, float rgb[3])
{
    const json_t *value = json_object_get(settings, name);
    for (size_t c = 0; c < 3 && value != NULL; c++)
        rgb[c] = (float)json_number_value(json_is_array(value) ? json_array_get(value, c) : value);
    return value != NULL;
}

/* Applies the settings to a light's, a material's or the sky's values: first sets, then scales, then switches off. */
static void change(float to[3], const json_t *settings, const char *set, const char *scale)
{
    float factor[3] = {1.0f, 1.0f, 1.0f};
    (void)three(settings, set, to);
    (void)three(settings, scale, factor);
    for (int c = 0; c < 3; c++)
        to[c] =
            json_is_false(json_object_get(settings, "on")) ? 0.0f : fminf(to[c] * factor[c], (float)KILN_LIGHT_MOST);
}

/* ---- what is changed ---- */

static void change_light(const struct kiln_changeable *s, size_t i, const json_t *settings)
{
    change(s->lights[i].intensity, settings, "intensity", "scale");
}

static void change_material(const struct kiln_changeable *s, size_t i, const json_t *settings)
{
    change(s->materials[i].emission, settings, "emission", "emission-scale");
    (void)three(settings, "albedo", s->materials[i].base_color);
}

static uint32_t light_name(const struct kiln_changeable *s, size_t i) { return s->lights[i].name; }
static uint32_t material_name(const struct kiln_changeable *s, size_t i) { return s->materials[i].name; }
static size_t light_count(const struct kiln_changeable *s) { return s->light_count; }
static size_t material_count(const struct kiln_changeable *s) { return s->material_count; }

/* A kind of things that have names. */
static const struct kind {
    const char *key, *one;
    const struct setting *settings;
    size_t (*count)(const struct kiln_changeable *);
    uint32_t (*name)(const struct kiln_changeable *, size_t);
    void (*change)(const struct kiln_changeable *, size_t, const json_t *);
} kinds[] = {{"lights", "light", light_settings, light_count, light_name, change_light},
             {"materials", "material", material_settings, material_count, material_name, change_material}};
enum { KINDS = sizeof kinds / sizeof *kinds };

/* Finds the name of this kind that is most like the pattern; empty: there are none. */
static const char *nearest(const struct kiln_changeable *s, const struct kind *kind, const char *pattern)
{
    const char *best = "";
    for (size_t i = 0; i < kind->count(s); i++) {
        const char *name = s->strings + kind->name(s, i);
        if (i == 0 || kiln_edit_distance(pattern, name) < kiln_edit_distance(pattern, best))
            best = name;
    }
    return best;
}

static int apply_rule(const struct kiln_changeable *s, const struct kind *kind, const char *pattern,
                      const json_t *settings, struct kiln_error *error)
{
    char where[300];
    size_t matched = 0;
    (void)snprintf(where, sizeof where, "%s '%.200s'", kind->one, pattern);
    const int status = check(where, settings, kind->settings, error);
    for (size_t i = 0; status == KILN_OK && i < kind->count(s); i++) {
        const char *name = s->strings + kind->name(s, i);
        if (strcmp(pattern, name) != 0 && fnmatch(pattern, name, 0) != 0)
            continue;
        kind->change(s, i, settings);
        matched++;
    }
    if (status != KILN_OK || matched > 0)
        return status;
    return kind->count(s) == 0
               ? kiln_fail(error, KILN_USAGE, "changes: the scene has no %s, and so none of the name '%.200s'",
                           kind->one, pattern)
               : kiln_fail(error, KILN_USAGE,
                           "changes: no %s of the scene has a name that matches '%.200s'; the nearest is '%.200s'",
                           kind->one, pattern, nearest(s, kind, pattern));
}

static int apply_kind(const struct kiln_changeable *s, const struct kind *kind, const json_t *rules,
                      struct kiln_error *error)
{
    const char *pattern;
    json_t *settings;
    int status = rules == NULL || json_is_object(rules)
                     ? KILN_OK
                     : kiln_fail(error, KILN_USAGE, "changes: %s is a mapping of names", kind->key);
    json_object_foreach((json_t *)(uintptr_t)rules, pattern, settings)
    {
        status = apply_rule(s, kind, pattern, settings, error);
        if (status != KILN_OK)
            break;
    }
    return status;
}

static int check_keys(const json_t *changes, struct kiln_error *error)
{
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)(uintptr_t)changes, key, value)
    {
        bool known = strcmp(key, "environment") == 0;
        for (int k = 0; k < KINDS; k++)
            known = known || strcmp(key, kinds[k].key) == 0;
        if (!known)
            return kiln_fail(error, KILN_USAGE,
                             "changes: there is no key '%.100s'; there are lights, materials and environment", key);
    }
    const json_t *sky = json_object_get(changes, "environment");
    return sky != NULL ? check("environment", sky, environment_settings, error) : KILN_OK;
}

static json_t *read_text(const char *text)
{
    return text == NULL || text[0] == '\0' ? NULL : json_loads(text, 0, NULL);
}

int kiln_changes_apply_to(const struct kiln_changeable *scene, const char *text, struct kiln_error *error)
{
    json_t *changes = read_text(text);
    int status = check_keys(changes, error);
    for (int k = 0; k < KINDS && status == KILN_OK; k++)
        status = apply_kind(scene, &kinds[k], json_object_get(changes, kinds[k].key), error);
    json_decref(changes);
    return status;
}

void kiln_changes_apply_to_environment(struct kiln_environment *e, const char *text)
{
    json_t *changes = read_text(text);
    const json_t *sky = json_object_get(changes, "environment"), *turn = json_object_get(sky, "rotation");
    if (sky != NULL) {
        if (e->kind == KILN_ENVIRONMENT_NONE && json_object_get(sky, "radiance") != NULL)
            *e = (struct kiln_environment){.kind = KILN_ENVIRONMENT_CONSTANT, .rotation = e->rotation};
        change(e->radiance, sky, "radiance", "scale");
        if (turn != NULL)
            e->rotation = (float)(fmod(json_number_value(turn), 360.0) * KILN_PI / 180.0);
        if (!(e->radiance[0] > 0.0f) && !(e->radiance[1] > 0.0f) && !(e->radiance[2] > 0.0f))
            *e = (struct kiln_environment){.kind = KILN_ENVIRONMENT_NONE};
    }
    json_decref(changes);
}

int kiln_changes_apply(struct kiln_builder *builder, const char *text, struct kiln_error *error)
{
    const struct kiln_changeable scene = {.strings = KILN_BUILDER_DATA(builder, const char, KILN_SECTION_STRINGS),
                                          .lights = KILN_BUILDER_DATA(builder, struct kiln_light, KILN_SECTION_LIGHTS),
                                          .light_count = builder->sections[KILN_SECTION_LIGHTS].count,
                                          .materials =
                                              KILN_BUILDER_DATA(builder, struct kiln_material, KILN_SECTION_MATERIALS),
                                          .material_count = builder->sections[KILN_SECTION_MATERIALS].count};
    return kiln_changes_apply_to(&scene, text, error);
}

void kiln_changes_apply_environment(struct kiln_builder *builder, const char *text)
{
    kiln_changes_apply_to_environment(KILN_BUILDER_DATA(builder, struct kiln_environment, KILN_SECTION_ENVIRONMENT),
                                      text);
}

/* ---- writing the changed scene file ---- */

/* Writes changed values into the bytes of a scene file. Materials in memory may differ from those in the file
 * (worker/scene/gloss.h), so unchanged ones are left alone. */
static void patch(unsigned char *file, const struct kiln_scene *scene, const struct kiln_changeable *before,
                  const struct kiln_changeable *now, const struct kiln_environment *environment)
{
    const struct kiln_scene_header *h = scene->header;
    struct kiln_light *lights = (struct kiln_light *)(void *)(file + h->sections[KILN_SECTION_LIGHTS].offset);
    struct kiln_material *materials =
        (struct kiln_material *)(void *)(file + h->sections[KILN_SECTION_MATERIALS].offset);
    for (size_t i = 0; i < now->light_count; i++)
        lights[i] = now->lights[i];
    for (size_t i = 0; i < now->material_count; i++)
        for (int c = 0; c < 3; c++) {
            const struct kiln_material *a = &before->materials[i], *b = &now->materials[i];
            if (memcmp(&a->emission[c], &b->emission[c], sizeof(float)) != 0)
                materials[i].emission[c] = b->emission[c];
            if (memcmp(&a->base_color[c], &b->base_color[c], sizeof(float)) != 0)
                materials[i].base_color[c] = b->base_color[c];
        }
    memcpy(file + h->sections[KILN_SECTION_ENVIRONMENT].offset, environment, sizeof *environment);
}

int kiln_changes_write_scene(const struct kiln_scene *scene, const struct kiln_changeable *before,
                             const struct kiln_changeable *now, const struct kiln_environment *environment,
                             const char *directory, uint64_t hash[2], struct kiln_error *error)
{
    const size_t header_bytes = kiln_scene_header_bytes(scene->header->version);
    unsigned char *file = NULL;
    int status = kiln_allocate(&file, scene->mapped_bytes, 1, "the scene file of a state", error);
    if (status != KILN_OK)
        return status;
    memcpy(file, scene->mapped, scene->mapped_bytes);
    patch(file, scene, before, now, environment);
    struct kiln_scene_header header = {0};
    memcpy(&header, file, header_bytes);
    memset(header.import_hash, 0, sizeof header.import_hash); /* no import makes it */
    kiln_scene_content_hash(&header, file + header_bytes, header.content_hash);
    memcpy(file, &header, header_bytes);
    memcpy(hash, header.content_hash, sizeof header.content_hash);
    status = kiln_publish_bytes_below(directory, "scene.kscene", file, scene->mapped_bytes, error);
    kiln_free(&file);
    return status;
}
