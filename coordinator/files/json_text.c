#include "coordinator/files/json_text.h"

#include <stdbool.h>

/* Index of the byte after the string that begins at `at`. */
static size_t skip_string(const char *text, size_t size, size_t at)
{
    for (at++; at < size && text[at] != '"'; at++)
        at += text[at] == '\\';
    return at + 1;
}

/* Checks the number of values and the depth by counting brackets and commas. */
static bool is_bounded(const char *text, size_t size)
{
    size_t depth = 0, values = 1;
    for (size_t at = 0; at < size;) {
        const char c = text[at];
        if (c == '"') {
            at = skip_string(text, size, at);
            continue;
        }
        values += c == ',' || c == '[' || c == '{';
        depth += c == '[' || c == '{';
        depth -= (c == ']' || c == '}') && depth > 0;
        if (depth > KILN_JSON_DEPTH_MOST || values > KILN_JSON_VALUES_MOST)
            return false;
        at++;
    }
    return true;
}

json_t *kiln_json_text(const char *text, size_t size, const char *path, struct kiln_error *error)
{
    json_error_t where = {.line = 0};
    if (!is_bounded(text, size)) {
        (void)kiln_fail(error, KILN_BAD_INPUT,
                        "'%s' has more than %d values or is nested deeper than %d: kiln writes no such file", path,
                        (int)KILN_JSON_VALUES_MOST, (int)KILN_JSON_DEPTH_MOST);
        return NULL;
    }
    json_t *json = json_loadb(text, size, 0, &where);
    if (json == NULL)
        (void)kiln_fail(error, KILN_BAD_INPUT, "'%s' is not JSON: line %d: %s", path, where.line, where.text);
    return json;
}
