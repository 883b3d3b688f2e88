#include "coordinator/import/settings.h"

#include <fnmatch.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/job/options.h"
#include "coordinator/import/builder.h"

/* ---- one setting ---- */

/* The table of keys and how their values are read. */
struct key {
    const char *name;
    const char *wanted; /* completes "it must be ..." */
    bool (*read)(struct kiln_object_settings *settings, const json_t *value);
};

static bool read_scale(struct kiln_object_settings *settings, const json_t *value)
{
    const double scale = json_number_value(value);
    settings->density_scale = scale;
    return json_is_number(value) && scale >= 0.001 && scale <= 1000.0;
}

/* Reads a whole number, also if written as 128.0. */
static bool read_size(struct kiln_object_settings *settings, const json_t *value)
{
    const double size = json_number_value(value);
    if (!json_is_number(value) || !(size >= 1.0 && size <= 32768.0) || size != floor(size))
        return false;
    settings->lightmap_size = (uint32_t)size;
    return true;
}

/* Reads a truth value. Custom properties of modelling programs may have only the numbers 0 and 1. */
static bool read_exclude(struct kiln_object_settings *settings, const json_t *value)
{
    const bool number = json_is_number(value) && (json_number_value(value) == 0.0 || json_number_value(value) == 1.0);
    settings->exclude = json_is_true(value) || json_number_value(value) == 1.0 ? KILN_EXCLUDE_YES : KILN_EXCLUDE_NO;
    return json_is_boolean(value) || number;
}

/* The index of a word in a list, from 1 on; 0: not in it. */
static uint8_t place_of(const json_t *value, const char *const *words, uint8_t count)
{
    const char *text = json_string_value(value);
    for (uint8_t i = 0; text != NULL && i < count; i++)
        if (strcmp(text, words[i]) == 0)
            return (uint8_t)(i + 1);
    return 0;
}

static bool read_role(struct kiln_object_settings *settings, const json_t *value)
{
    /* in the order of enum kiln_object_role */
    static const char *const words[] = {"both", "caster-only", "receiver-only"};
    settings->role = place_of(value, words, 3);
    return settings->role != KILN_ROLE_UNSET;
}

static bool read_sides(struct kiln_object_settings *settings, const json_t *value)
{
    static const char *const words[] = {"one", "two"}; /* in the order of enum kiln_object_sides */
    settings->sides = place_of(value, words, 2);
    return settings->sides != KILN_SIDES_UNSET;
}

static const struct key keys[] = {{"density-scale", "a number from 0.001 to 1000", read_scale},
                                  {"lightmap-size", "a whole number from 1 to 32768", read_size},
                                  {"exclude", "true or false", read_exclude},
                                  {"role", "both, caster-only or receiver-only", read_role},
                                  {"sides", "one or two", read_sides}};
enum { KEY_COUNT = sizeof keys / sizeof *keys, KEY_LENGTH = 32 };

static const struct key *find_key(const char *name)
{
    char plain[KEY_LENGTH];
    (void)snprintf(plain, sizeof plain, "%s", name);
    for (char *c = plain; *c != '\0'; c++)
        *c = *c == '_' ? '-' : *c;
    for (size_t i = 0; i < KEY_COUNT; i++)
        if (strcmp(plain, keys[i].name) == 0)
            return &keys[i];
    return NULL;
}

const char *kiln_object_settings_nearest(const char *name)
{
    size_t best = 0;
    for (size_t i = 1; i < KEY_COUNT; i++)
        if (kiln_edit_distance(name, keys[i].name) < kiln_edit_distance(name, keys[best].name))
            best = i;
    return keys[best].name;
}

int kiln_object_settings_read(struct kiln_object_settings *settings, const char *name, const json_t *value,
                              const char *where, int status, bool *known, struct kiln_error *error)
{
    const struct key *key = find_key(name);
    *known = key != NULL;
    if (key == NULL || key->read(settings, value))
        return KILN_OK;
    char *text = json_dumps(value, JSON_ENCODE_ANY | JSON_COMPACT);
    const int result = kiln_fail(error, status, "%s: %s is %.100s; it must be %s", where, key->name,
                                 text == NULL ? "" : text, key->wanted);
    free(text);
    return result;
}

/* ---- rules ---- */

/* Overwrites settings by those that a later rule sets. */
static void merge(struct kiln_object_settings *settings, const struct kiln_object_settings *rule)
{
    if (rule->density_scale != 0.0)
        settings->density_scale = rule->density_scale;
    if (rule->lightmap_size != 0)
        settings->lightmap_size = rule->lightmap_size;
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
                builder, KILN_NOTE_SAID, error,
                "objects '%.200s': no object of the scene has a name that matches; kiln info --verbose lists the names",
                pattern);
        if (status != KILN_OK)
            break;
    }
    json_decref(rules);
    return status;
}

/* ---- what follows from the settings ---- */

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
        status = kiln_builder_note(builder, 0, error, "%zu objects are left out of the bake, as asked for", excluded);
    if (status == KILN_OK && casters > 0)
        status = kiln_builder_note(builder, 0, error, "%zu objects are caster-only: their lightmaps are not published",
                                   casters);
    if (status == KILN_OK && receivers > 0)
        status = kiln_builder_note(builder, 0, error, "%zu objects are receiver-only: no ray hits them", receivers);
    return status;
}

int kiln_object_settings_apply(struct kiln_builder *builder, const char *rules, struct kiln_error *error)
{
    int status = rules == NULL || rules[0] == '\0' ? KILN_OK : apply_rules(builder, rules, error);
    if (status == KILN_OK)
        status = note_roles(builder, keep_objects(builder), error);
    return status;
}
