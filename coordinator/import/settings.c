#include "coordinator/import/settings.h"

#include <fnmatch.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/import/lods.h"

/* Overwrites settings with those that a later rule specifies. */
static void merge(struct kiln_object_settings *settings, const struct kiln_object_settings *rule)
{
    if (rule->density_scale != 0.0)
        settings->density_scale = rule->density_scale;
    if (rule->lightmap_size != 0)
        settings->lightmap_size = rule->lightmap_size;
    if (rule->lightmap_size != 0 || (rule->density_scale != 0.0 && settings->lightmap_size == 0))
        settings->size_of_file = false;
    if (rule->role != KILN_ROLE_UNSET)
        settings->role = rule->role;
    if (rule->sides != KILN_SIDES_UNSET)
        settings->sides = rule->sides;
    if (rule->exclude != KILN_EXCLUDE_UNSET)
        settings->exclude = rule->exclude;
}

static int read_rule(const char *pattern, const json_t *json, struct kiln_object_settings *rule,
                     struct kiln_error *error)
{
    const char *key;
    json_t *value;
    char where[300];
    int status = KILN_OK;
    *rule = (struct kiln_object_settings){0};
    (void)snprintf(where, sizeof where, "objects '%.200s'", pattern);
    json_object_foreach((json_t *)(uintptr_t)json, key, value)
    {
        bool known = false;
        status = kiln_object_settings_read(rule, key, value, where, KILN_USAGE, &known, error);
        if (status == KILN_OK && !known)
            status = kiln_fail(error, KILN_USAGE, "%s: there is no setting '%.100s'; the nearest one is '%s'", where,
                               key, kiln_object_settings_nearest(key));
        if (status != KILN_OK)
            break;
    }
    return status;
}

/* Whether a name matches a pattern; a pattern that equals the name matches too, even if it contains brackets. */
static bool matches(const char *pattern, const char *name)
{
    return strcmp(pattern, name) == 0 || fnmatch(pattern, name, 0) == 0;
}

static size_t apply_rule(struct kiln_builder *builder, const char *pattern, const struct kiln_object_settings *rule)
{
    const struct kiln_object *objects = KILN_BUILDER_DATA(builder, const struct kiln_object, KILN_SECTION_OBJECTS);
    const char *strings = KILN_BUILDER_DATA(builder, const char, KILN_SECTION_STRINGS);
    size_t matched = 0;
    for (size_t i = 0; i < builder->sections[KILN_SECTION_OBJECTS].count; i++) {
        if (!matches(pattern, strings + objects[i].original_name) && !matches(pattern, strings + objects[i].name))
            continue;
        merge(&builder->object_settings[i], rule);
        matched++;
    }
    return matched;
}

static int apply_rules(struct kiln_builder *builder, const char *text, struct kiln_error *error)
{
    const char *pattern;
    json_t *rules = json_loads(text, JSON_REJECT_DUPLICATES, NULL), *settings;
    int status = json_is_object(rules)
                     ? KILN_OK
                     : kiln_fail(error, KILN_USAGE, "the rules for objects are not a JSON object: %.100s", text);
    json_object_foreach(rules, pattern, settings)
    {
        struct kiln_object_settings rule;
        status = read_rule(pattern, settings, &rule, error);
        if (status == KILN_OK && apply_rule(builder, pattern, &rule) == 0)
            status = kiln_builder_note(
                builder, KILN_NOTE_REPEATED, error,
                "objects '%.200s': no object of the scene has a name that matches; kiln info --verbose lists the names",
                pattern);
        if (status != KILN_OK)
            break;
    }
    json_decref(rules);
    return status;
}

/* ---- flags and lists that result from the settings ---- */

static uint32_t flags_of(const struct kiln_object_settings *settings)
{
    return (settings->role == KILN_ROLE_CASTER_ONLY ? KILN_OBJECT_CASTER_ONLY : 0u) |
           (settings->role == KILN_ROLE_RECEIVER_ONLY ? KILN_OBJECT_RECEIVER_ONLY : 0u) |
           (settings->sides == KILN_SIDES_TWO ? KILN_OBJECT_BOTH_SIDES : 0u) |
           (settings->sides == KILN_SIDES_ONE ? KILN_OBJECT_ONE_SIDE : 0u);
}

/* Removes the excluded objects from the list. */
static size_t keep_objects(struct kiln_builder *builder)
{
    struct kiln_object *objects = KILN_BUILDER_DATA(builder, struct kiln_object, KILN_SECTION_OBJECTS);
    const size_t count = builder->sections[KILN_SECTION_OBJECTS].count;
    size_t kept = 0;
    for (size_t i = 0; i < count; i++) {
        if (builder->object_settings[i].exclude == KILN_EXCLUDE_YES)
            continue;
        objects[kept] = objects[i];
        objects[kept].flags |= flags_of(&builder->object_settings[i]);
        builder->object_settings[kept++] = builder->object_settings[i];
    }
    builder->sections[KILN_SECTION_OBJECTS].count = kept;
    return count - kept;
}

static int note_roles(struct kiln_builder *builder, size_t excluded, struct kiln_error *error)
{
    const struct kiln_object *objects = KILN_BUILDER_DATA(builder, const struct kiln_object, KILN_SECTION_OBJECTS);
    size_t casters = 0, receivers = 0;
    for (size_t i = 0; i < builder->sections[KILN_SECTION_OBJECTS].count; i++) {
        casters += (objects[i].flags & KILN_OBJECT_CASTER_ONLY) != 0;
        receivers += (objects[i].flags & KILN_OBJECT_RECEIVER_ONLY) != 0;
    }
    int status = KILN_OK;
    if (excluded > 0)
        KILN_TRY(kiln_builder_note(builder, 0, error, "%zu objects are left out of the bake, as asked for", excluded));
    if (casters > 0)
        KILN_TRY(kiln_builder_note(builder, 0, error, "%zu objects are caster-only: their lightmaps are not published",
                                   casters));
    if (receivers > 0)
        KILN_TRY(kiln_builder_note(builder, 0, error, "%zu objects are receiver-only: no ray hits them", receivers));
end:
    return status;
}

int kiln_object_settings_apply(struct kiln_builder *builder, const char *rules, struct kiln_error *error)
{
    int status = rules == NULL || rules[0] == '\0' ? KILN_OK : apply_rules(builder, rules, error);
    const size_t excluded = status == KILN_OK ? keep_objects(builder) : 0;
    size_t lower = 0;
    KILN_TRY(status);
    KILN_TRY(kiln_lods_leave_out(builder, &lower, error));
    if (lower > 0)
        (void)keep_objects(builder);
    KILN_TRY(note_roles(builder, excluded, error));
end:
    return status;
}
