#include "coordinator/import/missing.h"

#include <stdio.h>
#include <string.h>

enum { NOTES_MOST = 256, SHOWN = 200, PATH_LENGTH = 1024 };

/* The name without the folders of another computer. */
static const char *last_step(const char *name)
{
    const char *last = name;
    for (const char *c = name; *c != '\0'; c++)
        last = *c == '/' || *c == '\\' ? c + 1 : last;
    return last;
}

/* Records a missing picture, under its given name and beside the scene file, so that the scene is imported again once
 * the picture is there. */
static int record(struct kiln_confine *confine, struct kiln_builder *builder, const char *folder, const char *name,
                  struct kiln_error *error)
{
    const char *const ways[] = {name, last_step(name)};
    int status = KILN_OK;
    for (size_t i = 0; i < 2 && status == KILN_OK; i++) {
        char path[PATH_LENGTH + 1];
        const int length = snprintf(path, sizeof path, "%s%s", folder, ways[i]);
        for (char *c = path; *c != '\0'; c++)
            *c = *c == '\\' ? '/' : *c;
        if (length > 0 && length <= PATH_LENGTH && path[0] != '/' && kiln_confine_is_missing(confine, path))
            status = kiln_confine_record_missing(confine, builder, path, error);
    }
    return status;
}

int kiln_missing_add(struct kiln_missing *missing, struct kiln_confine *confine, struct kiln_builder *builder,
                     const char *place, const char *folder, const char *name, bool matters, const char *instead,
                     struct kiln_error *error)
{
    const size_t length = strlen(missing->names);
    if (length + SHOWN + 8 < KILN_MISSING_NAMES)
        (void)snprintf(missing->names + length, KILN_MISSING_NAMES - length, "%s'%.*s'", length > 0 ? ", " : "", SHOWN,
                       name);
    const int status = record(confine, builder, folder, name, error);
    if (status != KILN_OK || missing->count++ >= NOTES_MOST)
        return status;
    return kiln_builder_note(builder, matters ? KILN_NOTE_REPEATED : KILN_NOTE_WARNING, error,
                             "%s: the picture '%.*s' is missing in the scene's folder; %s", place, SHOWN, name,
                             instead);
}

int kiln_missing_end(const struct kiln_missing *missing, const struct kiln_confine *confine,
                     struct kiln_builder *builder, struct kiln_error *error)
{
    if (missing->count > 0 && builder->strict)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.300s: %llu pictures are missing in the scene's folder (%s); put them there, or leave out "
                         "--strict",
                         confine->scene, (unsigned long long)missing->count, missing->names);
    return missing->count <= NOTES_MOST
               ? KILN_OK
               : kiln_builder_note(builder, KILN_NOTE_REPEATED, error, "%llu more pictures are missing",
                                   (unsigned long long)(missing->count - NOTES_MOST));
}
