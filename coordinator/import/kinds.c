#include "coordinator/import/kinds.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

enum { LINE_LENGTH = 900 };

void kiln_kinds_add(struct kiln_kinds *kinds, uint64_t count, const char *format, ...)
{
    char name[KILN_KINDS_NAME];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(name, sizeof name, format, arguments);
    va_end(arguments);
    size_t at = 0;
    while (at < kinds->used && strcmp(kinds->kinds[at].name, name) != 0)
        at++;
    if (count == 0)
        return;
    if (at == KILN_KINDS_MOST) {
        kinds->others += count;
        return;
    }
    if (at == kinds->used)
        (void)snprintf(kinds->kinds[kinds->used++].name, KILN_KINDS_NAME, "%s", name);
    kinds->kinds[at].count += count;
}

int kiln_kinds_note(const struct kiln_kinds *kinds, struct kiln_builder *builder, uint32_t severity, const char *begin,
                    struct kiln_error *error)
{
    char line[LINE_LENGTH + KILN_KINDS_NAME + 64];
    int status = KILN_OK;
    for (size_t i = 0; i < kinds->used && status == KILN_OK;) {
        size_t length = 0;
        for (; i < kinds->used && length < LINE_LENGTH; i++)
            length += (size_t)snprintf(line + length, sizeof line - length, "%s%llu %s", length > 0 ? "; " : "",
                                       (unsigned long long)kinds->kinds[i].count, kinds->kinds[i].name);
        if (i == kinds->used && kinds->others > 0 && length < sizeof line)
            (void)snprintf(line + length, sizeof line - length, "; %llu of other kinds",
                           (unsigned long long)kinds->others);
        status = kiln_builder_note(builder, severity, error, "%s: %s", begin, line);
    }
    return status;
}
