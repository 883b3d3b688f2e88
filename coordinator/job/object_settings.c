#include "coordinator/job/object_settings.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/job/options.h"

/* A key, and how its value is read. */
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

/* Reads a whole number, which may be written as 128.0. */
static bool read_size(struct kiln_object_settings *settings, const json_t *value)
{
    const double size = json_number_value(value);
    if (!json_is_number(value) || !(size >= 1.0 && size <= 32768.0) || size != floor(size))
        return false;
    settings->lightmap_size = (uint32_t)size;
    return true;
}

/* Reads a truth value, also as 0 or 1, since custom properties of modelling programs may have no truth values. */
static bool read_exclude(struct kiln_object_settings *settings, const json_t *value)
{
    const bool number = json_is_number(value) && (json_number_value(value) == 0.0 || json_number_value(value) == 1.0);
    settings->exclude = json_is_true(value) || json_number_value(value) == 1.0 ? KILN_EXCLUDE_YES : KILN_EXCLUDE_NO;
    return json_is_boolean(value) || number;
}

/* Returns the position of a word in a list, counted from 1; 0: it is not in the list. */
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
