#include "worker/pass/links_file.h"

#include <errno.h>
#include <stdbool.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "worker/base/memory.h"
#include "worker/pass/links.h"

enum { ENTRIES = 4096 }; /* that are read at a time */

struct file {
    int descriptor;
    const char *path;
    struct kiln_links_header header;
    struct kiln_kept_links *links; /* of one tile run */
    size_t room;
};

int kiln_links_read_at(int descriptor, const char *path, void *to, size_t bytes, uint64_t at, struct kiln_error *error)
{
    for (size_t done = 0; done < bytes;) {
        const ssize_t got = pread(descriptor, (char *)to + done, bytes - done, (off_t)(at + done));
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return kiln_fail_errno(error, KILN_IO, "cannot read '%s'", path);
        if (got == 0)
            return kiln_fail(error, KILN_BAD_INPUT, "'%s' ends too early: bake again with --keep-transport links",
                             path);
        done += (size_t)got;
    }
    return KILN_OK;
}

static int check_header(struct file *f, struct kiln_error *error)
{
    struct stat found;
    struct kiln_links_header *h = &f->header;
    const int status = kiln_links_read_at(f->descriptor, f->path, h, sizeof *h, 0, error);
    if (status != KILN_OK)
        return status;
    const bool good = memcmp(h->magic, KILN_LINKS_MAGIC, sizeof h->magic) == 0 && h->version == KILN_LINKS_VERSION &&
                      fstat(f->descriptor, &found) == 0 && (uint64_t)found.st_size == h->bytes &&
                      h->runs <= h->points && h->bytes >= KILN_LINKS_BEGIN &&
                      h->runs <= (h->bytes - KILN_LINKS_BEGIN) / sizeof(struct kiln_links_entry);
    return good ? KILN_OK : kiln_fail(error, KILN_BAD_INPUT, "'%s' is not a file of links of this version", f->path);
}

/* The links of a tile run whose points end before `end`. */
static int check_run(struct file *f, const struct kiln_links_entry *e, uint64_t end, struct kiln_error *error)
{
    struct kiln_error why;
    const struct kiln_links_header *h = &f->header;
    if (e->first >= end || end - e->first > KILN_TILE_TEXELS || e->offset > h->bytes || e->bytes > h->bytes - e->offset)
        return kiln_fail(error, KILN_BAD_INPUT, "'%s': the table has no sound entry for surface point %llu", f->path,
                         (unsigned long long)e->first);
    if (e->bytes == 0)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_grow(&f->links, &f->room, 1 + e->bytes / sizeof *f->links + 1, sizeof *f->links,
                       "the links of a tile", error));
    *f->links = (struct kiln_kept_links){.first = e->first, .points = (uint32_t)(end - e->first), .bytes = e->bytes};
    KILN_TRY(kiln_links_read_at(f->descriptor, f->path, f->links->code, e->bytes, e->offset, error));
    if (kiln_links_check(f->links, h->points, &why) != KILN_OK)
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "'%s': %.300s", f->path, why.message));
end:
    return status;
}

static int check_runs(struct file *f, struct kiln_links_entry *entries, struct kiln_error *error)
{
    const struct kiln_links_header *h = &f->header;
    int status = KILN_OK;
    for (uint64_t i = 0; i < h->runs && status == KILN_OK; i += ENTRIES) {
        const uint64_t some = h->runs - i < ENTRIES ? h->runs - i : ENTRIES,
                       ahead = i + some < h->runs ? some + 1 : some; /* the next entry tells where the last one ends */
        status = kiln_links_read_at(f->descriptor, f->path, entries, (size_t)ahead * sizeof *entries,
                                    KILN_LINKS_BEGIN + i * sizeof *entries, error);
        for (uint64_t k = 0; k < some && status == KILN_OK; k++)
            status = check_run(f, &entries[k], k + 1 < ahead ? entries[k + 1].first : h->points, error);
    }
    return status;
}

int kiln_links_file_check(int descriptor, const char *path, struct kiln_error *error)
{
    struct file f = {.descriptor = descriptor, .path = path};
    struct kiln_links_entry *entries = NULL;
    int status;
    KILN_TRY(check_header(&f, error));
    KILN_TRY(kiln_allocate(&entries, ENTRIES + 1, sizeof *entries, "entries of links", error));
    KILN_TRY(check_runs(&f, entries, error));
end:
    kiln_free(&entries);
    kiln_free(&f.links);
    return status;
}
