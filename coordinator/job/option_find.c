#include "coordinator/job/options.h"

#include <stdlib.h>
#include <string.h>

static bool is_called(const struct kiln_option *option, const char *name)
{
    return strcmp(option->name, name) == 0 || (option->former != NULL && strcmp(option->former, name) == 0);
}

const struct kiln_option *kiln_option_find(const char *name)
{
    for (size_t i = 0; i < kiln_option_count; i++)
        if (is_called(&kiln_options[i], name))
            return &kiln_options[i];
    return NULL;
}

const struct kiln_option *kiln_option_find_for(const char *name, uint32_t commands)
{
    for (size_t i = 0; i < kiln_option_count; i++)
        if ((kiln_options[i].commands & commands) != 0 && is_called(&kiln_options[i], name))
            return &kiln_options[i];
    return kiln_option_find(name);
}

const struct kiln_option *kiln_option_second(const struct kiln_option *option)
{
    for (size_t i = 0; i < kiln_option_count; i++)
        if (kiln_options[i].second_of != NULL && strcmp(kiln_options[i].second_of, option->name) == 0 &&
            (kiln_options[i].commands & option->commands) != 0)
            return &kiln_options[i];
    return NULL;
}

const struct kiln_command *kiln_command_find(const char *name)
{
    for (size_t i = 0; i < kiln_command_count; i++)
        if (strcmp(kiln_commands[i].name, name) == 0)
            return &kiln_commands[i];
    return NULL;
}

const char *kiln_option_default(const struct kiln_option *option)
{
    if (option->shown != NULL)
        return option->shown;
    if (option->kind == KILN_OPTION_FLAG)
        return strcmp(option->fallback, "true") == 0 ? "on" : "";
    return option->fallback != NULL ? option->fallback : "";
}

/* Edit distance with transpositions, by Wagner and Fischer's dynamic programming. Names are cut at a length that no
 * known name has; this cannot make a wrong name more similar. */
size_t kiln_edit_distance(const char *a, const char *b)
{
    enum { LIMIT = 48 };
    const size_t rows = strnlen(a, LIMIT), columns = strnlen(b, LIMIT);
    size_t distance[LIMIT + 1][LIMIT + 1];
    for (size_t i = 0; i <= rows; i++)
        distance[i][0] = i;
    for (size_t j = 0; j <= columns; j++)
        distance[0][j] = j;
    for (size_t i = 1; i <= rows; i++)
        for (size_t j = 1; j <= columns; j++) {
            size_t best = distance[i - 1][j - 1] + (a[i - 1] != b[j - 1]);
            if (distance[i - 1][j] + 1 < best)
                best = distance[i - 1][j] + 1;
            if (distance[i][j - 1] + 1 < best)
                best = distance[i][j - 1] + 1;
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] && distance[i - 2][j - 2] + 1 < best)
                best = distance[i - 2][j - 2] + 1;
            distance[i][j] = best;
        }
    return distance[rows][columns];
}

bool kiln_is_near(const char *name, const char *known)
{
    const size_t length = strlen(name), other = strlen(known);
    return 3 * kiln_edit_distance(name, known) < (length > other ? length : other) ||
           (length >= 3 && strncmp(name, known, length) == 0);
}

const char *kiln_option_nearest(const char *name, uint32_t commands)
{
    const char *nearest = NULL;
    size_t least = SIZE_MAX;
    for (size_t i = 0; i < kiln_option_count; i++) {
        const size_t distance = kiln_edit_distance(name, kiln_options[i].name);
        if ((kiln_options[i].commands & commands) != 0 && kiln_options[i].second_of == NULL && distance < least &&
            kiln_is_near(name, kiln_options[i].name)) {
            least = distance;
            nearest = kiln_options[i].name;
        }
    }
    return nearest;
}

const char *kiln_command_nearest(const char *name)
{
    const char *nearest = NULL;
    size_t least = SIZE_MAX;
    for (size_t i = 0; i < kiln_command_count; i++) {
        const size_t distance = kiln_edit_distance(name, kiln_commands[i].name);
        if (distance < least && kiln_is_near(name, kiln_commands[i].name)) {
            least = distance;
            nearest = kiln_commands[i].name;
        }
    }
    return nearest;
}

int kiln_command_unknown(const char *name, struct kiln_error *error)
{
    const char *nearest = kiln_command_nearest(name);
    if (name[0] == '-')
        return kiln_fail(error, KILN_USAGE,
                         "%.200s: the command comes first, such as kiln bake SCENE; kiln --help lists all", name);
    if (nearest == NULL)
        return kiln_fail(error, KILN_USAGE, "unknown command '%.200s'; kiln --help lists all", name);
    return kiln_fail(error, KILN_USAGE, "unknown command '%.200s'; the nearest one is '%s' (kiln --help lists all)",
                     name, nearest);
}
