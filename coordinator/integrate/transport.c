#include "coordinator/integrate/transport.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "worker/pass/gather.h"
#include "worker/pass/resident_rows.h"

bool kiln_transport_keeps(const struct kiln_step *step)
{
    return step->pass == &kiln_pass_gather && step->quantity == NULL;
}

void kiln_transport_name(const struct kiln_step *step, char name[KILN_TRANSPORT_NAME])
{
    (void)snprintf(name, KILN_TRANSPORT_NAME, "rows-%u-%u", step->stream, step->first_sample);
}

static struct kiln_rows_header header_of(const struct kiln_transport *t, const struct kiln_step *step)
{
    struct kiln_rows_header h = {.version = KILN_ROWS_VERSION,
                                 .samples = step->samples,
                                 .stream = step->stream,
                                 .first_sample = step->first_sample,
                                 .points = t->points};
    memcpy(h.magic, KILN_ROWS_MAGIC, sizeof h.magic);
    h.key = XXH3_64bits_withSeed(&h, sizeof h, t->key);
    return h;
}

/* Makes the file, as long as it will be. All ranks do: who comes later changes nothing. */
static int make_file(struct kiln_transport *t, const char *name, const struct kiln_rows_header *h,
                     struct kiln_error *error)
{
    t->rows.file = openat(t->folder, name, O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0666);
    if (t->rows.file < 0)
        return kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot create '%s'", t->path);
    if (ftruncate(t->rows.file, (off_t)kiln_rows_file_bytes(h->points, h->samples)) != 0)
        return kiln_fail_errno(error, KILN_IO, "cannot write '%s'", t->path);
    if (t->rank == 0 && pwrite(t->rows.file, h, sizeof *h, 0) != (ssize_t)sizeof *h)
        return kiln_fail_errno(error, KILN_IO, "cannot write '%s'", t->path);
    return KILN_OK;
}

/* Opens the file, unless it is not there, or of other samples: then rows.file stays -1. */
static int open_file(struct kiln_transport *t, const char *name, const struct kiln_rows_header *h,
                     struct kiln_error *error)
{
    struct kiln_rows_header there;
    struct stat file;
    t->rows.file = openat(t->folder, name, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    if (t->rows.file < 0 && errno == ENOENT)
        return KILN_OK;
    if (t->rows.file < 0 || fstat(t->rows.file, &file) != 0)
        return kiln_fail_errno(error, 0, "cannot read '%s'", t->path);
    const bool whole = pread(t->rows.file, &there, sizeof there, 0) == (ssize_t)sizeof there &&
                       memcmp(there.magic, h->magic, sizeof there.magic) == 0;
    if (whole && there.version == h->version && there.samples != h->samples) {
        (void)close(t->rows.file);
        t->rows.file = -1;
        return KILN_OK;
    }
    if (!whole || memcmp(&there, h, sizeof there) != 0 ||
        (uint64_t)file.st_size != kiln_rows_file_bytes(h->points, h->samples))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "'%s' is not as it was written, or of another bake; kiln verify says what else is damaged; "
                         "bake again with --keep-transport rows",
                         t->path);
    return KILN_OK;
}

int kiln_transport_begin(struct kiln_transport *t, struct kiln_backend *backend, const struct kiln_step *step,
                         struct kiln_error *error)
{
    char name[KILN_TRANSPORT_NAME];
    if (!t->is_on || t->of_links || !kiln_transport_keeps(step))
        return KILN_OK;
    kiln_transport_name(step, name);
    (void)snprintf(t->path, sizeof t->path, "%s/%s", t->directory, name);
    const struct kiln_rows_header h = header_of(t, step);
    t->rows =
        (struct kiln_rows){.file = -1, .path = t->path, .replays = t->replays, .samples = step->samples, .key = h.key};
    const int status = t->replays ? open_file(t, name, &h, error) : make_file(t, name, &h, error);
    if (status == KILN_OK && t->rows.file >= 0)
        kiln_backend_set_rows(backend, &t->rows);
    return status;
}

int kiln_transport_end(struct kiln_transport *t, struct kiln_backend *backend, struct kiln_error *error)
{
    int status = KILN_OK;
    if (!t->is_on || t->rows.path == NULL)
        return KILN_OK;
    kiln_backend_set_rows(backend, NULL);
    if (t->rows.file >= 0 && !t->replays && fdatasync(t->rows.file) != 0)
        status = kiln_fail_errno(error, KILN_IO, "cannot write '%s'", t->path);
    if (t->rows.file >= 0 && close(t->rows.file) != 0 && status == KILN_OK && !t->replays)
        status = kiln_fail_errno(error, KILN_IO, "cannot write '%s'", t->path);
    t->kept += t->rows.kept;
    t->found += t->rows.found;
    t->traced += t->rows.traced;
    t->rows = (struct kiln_rows){0};
    return status;
}

static int read_all(int file, const char *path, void *to, uint64_t bytes, uint64_t at, struct kiln_error *error)
{
    for (uint64_t done = 0; done < bytes;) {
        const ssize_t got = pread(file, (char *)to + done, (size_t)(bytes - done), (off_t)(at + done));
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return kiln_fail_errno(error, KILN_IO, "cannot read '%s'", path);
        done += (uint64_t)got;
    }
    return KILN_OK;
}

int kiln_transport_load(struct kiln_transport *t, const struct kiln_step *step, struct kiln_resident_rows *memory,
                        struct kiln_rows *rows, struct kiln_error *error)
{
    char name[KILN_TRANSPORT_NAME];
    const uint64_t row = kiln_rows_row_bytes(step->samples);
    kiln_transport_name(step, name);
    (void)snprintf(t->path, sizeof t->path, "%s/%s", t->directory, name);
    const struct kiln_rows_header h = header_of(t, step);
    int status = open_file(t, name, &h, error);
    if (status == KILN_OK && t->rows.file >= 0)
        status = read_all(t->rows.file, t->path, memory->rows, memory->count * row,
                          KILN_ROWS_BEGIN + memory->first * row, error);
    if (t->rows.file >= 0)
        (void)close(t->rows.file);
    t->rows = (struct kiln_rows){0};
    *rows = (struct kiln_rows){
        .file = -1, .path = t->path, .replays = true, .samples = step->samples, .key = h.key, .resident = memory};
    return status;
}
