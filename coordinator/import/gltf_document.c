#include "coordinator/import/gltf_document.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

void gltf_fail(struct gltf *g, struct gltf_place place, const char *key, const char *format, ...)
{
    if (g->status != KILN_OK)
        return;
    char text[768];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    char where[256] = "";
    if (place.array != NULL)
        (void)snprintf(where, sizeof where, "%s[%zu]%s%s", place.array, place.index, place.below,
                       key[0] != '\0' ? "." : "");
    g->status = kiln_fail(g->error, KILN_BAD_INPUT, "%.512s: %s%s %s; repair the file or export it again",
                          g->confine->scene, where, key, text);
}

void gltf_take(struct gltf *g, int status)
{
    if (g->status == KILN_OK)
        g->status = status;
}

static const char *type_name(json_type type)
{
    switch (type) {
    case JSON_OBJECT:
        return "an object";
    case JSON_ARRAY:
        return "an array";
    case JSON_STRING:
        return "a string";
    case JSON_INTEGER:
    case JSON_REAL:
        return "a number";
    case JSON_TRUE:
    case JSON_FALSE:
        return "a boolean";
    default:
        return "null";
    }
}

static json_t *member(struct gltf *g, struct gltf_place place, const json_t *object, const char *key, json_type type)
{
    json_t *value = json_object_get(object, key);
    if (value == NULL || json_typeof(value) == type)
        return value;
    gltf_fail(g, place, key, "is %s where %s belongs", type_name(json_typeof(value)), type_name(type));
    return NULL;
}

json_t *gltf_object(struct gltf *g, struct gltf_place place, const json_t *object, const char *key)
{
    return member(g, place, object, key, JSON_OBJECT);
}

json_t *gltf_array(struct gltf *g, struct gltf_place place, const json_t *object, const char *key)
{
    return member(g, place, object, key, JSON_ARRAY);
}

const char *gltf_string(struct gltf *g, struct gltf_place place, const json_t *object, const char *key)
{
    return json_string_value(member(g, place, object, key, JSON_STRING));
}

bool gltf_bool(struct gltf *g, struct gltf_place place, const json_t *object, const char *key, bool absent)
{
    const json_t *value = json_object_get(object, key);
    if (value == NULL)
        return absent;
    if (!json_is_boolean(value))
        gltf_fail(g, place, key, "is %s where true or false belongs", type_name(json_typeof(value)));
    return json_is_true(value);
}

uint64_t gltf_whole(struct gltf *g, struct gltf_place place, const json_t *object, const char *key, uint64_t low,
                    uint64_t high, uint64_t absent)
{
    const json_t *value = json_object_get(object, key);
    if (value == NULL)
        return absent;
    if (!json_is_number(value)) {
        gltf_fail(g, place, key, "is %s where a number belongs", type_name(json_typeof(value)));
        return absent;
    }
    /* "3.0" is a whole number too. Doubles hold all whole numbers that can occur. */
    const double number = json_number_value(value);
    if (!(number == floor(number)) || number < (double)low || number > (double)high) {
        gltf_fail(g, place, key, "is %.17g, not a whole number from %llu to %llu", number, (unsigned long long)low,
                  (unsigned long long)high);
        return absent;
    }
    return json_is_integer(value) ? (uint64_t)json_integer_value(value) : (uint64_t)number;
}

uint64_t gltf_needed(struct gltf *g, struct gltf_place place, const json_t *object, const char *key, uint64_t low,
                     uint64_t high)
{
    if (json_object_get(object, key) == NULL)
        gltf_fail(g, place, key, "is missing");
    return gltf_whole(g, place, object, key, low, high, low);
}

uint32_t gltf_index(struct gltf *g, struct gltf_place place, const json_t *object, const char *key, size_t limit)
{
    const json_t *value = json_object_get(object, key);
    if (value == NULL)
        return KILN_NONE;
    if (!json_is_integer(value)) {
        gltf_fail(g, place, key, "is %s where an index belongs",
                  json_is_real(value) ? "a fraction" : type_name(json_typeof(value)));
        return KILN_NONE;
    }
    const json_int_t index = json_integer_value(value);
    if (index < 0 || (uint64_t)index >= limit || index >= (json_int_t)KILN_NONE) {
        gltf_fail(g, place, key, "is %lld, but the file has %zu of these", (long long)index, limit);
        return KILN_NONE;
    }
    return (uint32_t)index;
}

double gltf_number(struct gltf *g, struct gltf_place place, const json_t *object, enum kiln_number which, double absent)
{
    const struct kiln_number_range *range = kiln_number_range(which);
    const char *key = range->key;
    const json_t *value = json_object_get(object, key);
    if (value == NULL)
        return absent;
    if (!json_is_number(value)) {
        gltf_fail(g, place, key, "is %s where a number belongs", type_name(json_typeof(value)));
        return absent;
    }
    const double number = json_number_value(value);
    if (!kiln_number_fits(which, number)) {
        gltf_fail(g, place, key, "is %.9g, outside %g to %g", number, range->low, range->high);
        return absent;
    }
    return number;
}

bool gltf_numbers(struct gltf *g, struct gltf_place place, const json_t *object, enum kiln_number which, size_t count,
                  double *values)
{
    const struct kiln_number_range *range = kiln_number_range(which);
    const char *key = range->key;
    const json_t *array = gltf_array(g, place, object, key);
    if (array == NULL)
        return false;
    if (json_array_size(array) != count) {
        gltf_fail(g, place, key, "has %zu numbers instead of %zu", json_array_size(array), count);
        return false;
    }
    for (size_t i = 0; i < count; i++) {
        const json_t *value = json_array_get(array, i);
        const double number = json_number_value(value);
        if (!json_is_number(value) || !kiln_number_fits(which, number)) {
            gltf_fail(g, place, key, "has element %zu that is not a number from %g to %g", i, range->low, range->high);
            return false;
        }
    }
    for (size_t i = 0; i < count; i++)
        values[i] = json_number_value(json_array_get(array, i));
    return true;
}

json_t *gltf_extension(struct gltf *g, struct gltf_place place, const json_t *object, const char *name)
{
    const json_t *extensions = gltf_object(g, place, object, "extensions");
    return extensions == NULL ? NULL : gltf_object(g, place, extensions, name);
}

size_t gltf_length(struct gltf *g, const char *array)
{
    return json_array_size(gltf_array(g, (struct gltf_place){0}, g->root, array));
}

json_t *gltf_element(struct gltf *g, const char *array, size_t index)
{
    json_t *element = json_array_get(json_object_get(g->root, array), index);
    if (json_is_object(element))
        return element;
    gltf_fail(g, (struct gltf_place){array, index, ""}, "", "is not an object");
    return NULL;
}
