#include <string.h>

#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"
#include "worker/base/memory.h"

/* Allocates `length` + 1 zero bytes that the job owns. */
static int keep_room(struct kiln_job *job, size_t length, char **copy, struct kiln_error *error)
{
    struct kiln_job_owned *own = job->strings;
    char *block = NULL;
    int status = kiln_grow(&own->strings, &own->capacity, own->count + 1, sizeof(char *), "the job", error);
    if (status == KILN_OK)
        status = kiln_allocate(&block, length + 1, 1, "the job", error);
    if (status != KILN_OK)
        return status;
    own->strings[own->count++] = block;
    *copy = block;
    return KILN_OK;
}

int kiln_job_keep(struct kiln_job *job, const char *text, size_t length, char **copy, struct kiln_error *error)
{
    const int status = keep_room(job, length, copy, error);
    if (status == KILN_OK)
        memcpy(*copy, text, length);
    return status;
}

int kiln_job_keep_room(struct kiln_job *job, size_t bytes, void **room, struct kiln_error *error)
{
    char *block = NULL;
    const int status = keep_room(job, bytes, &block, error);
    if (status == KILN_OK)
        memset(block, 0, bytes);
    *room = block;
    return status;
}

int kiln_job_keep_path(struct kiln_job *job, const char *path, const char *folder, char **copy,
                       struct kiln_error *error)
{
    if (folder == NULL || path[0] == '/' || strcmp(folder, ".") == 0)
        return kiln_job_keep(job, path, strlen(path), copy, error);
    const size_t before = strlen(folder), after = strlen(path);
    const bool slash = before > 0 && folder[before - 1] == '/';
    const int status = keep_room(job, before + !slash + after, copy, error);
    if (status != KILN_OK)
        return status;
    memcpy(*copy, folder, before);
    if (!slash)
        (*copy)[before] = '/';
    memcpy(*copy + before + !slash, path, after);
    return KILN_OK;
}

int kiln_job_keep_text(struct kiln_job *job, const char *text, char **copy, struct kiln_error *error)
{
    return kiln_job_keep(job, text, strlen(text), copy, error);
}

bool kiln_job_given(const struct kiln_job *job, const struct kiln_option *option)
{
    return ((const struct kiln_job_owned *)job->strings)->given[option - kiln_options];
}
