#include "coordinator/integrate/patches/link_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "coordinator/files/plain_file.h"
#include "coordinator/integrate/patches/links.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"
#include "worker/pass/links_file.h"

/* An open file, and its name in error messages. */
struct link_file {
    int descriptor;
    char path[4352];
};

static void name_file(struct link_file *f, const struct kiln_transport *t)
{
    f->descriptor = -1;
    (void)snprintf(f->path, sizeof f->path, "%s/" KILN_LINK_FILE, t->directory);
}

static uint64_t check_of(const struct kiln_kept_links *kept, uint64_t key)
{
    return XXH3_64bits_withSeed(kept->code, kept->bytes, key ^ (kept->first * 0x9e3779b97f4a7c15u));
}

/* Computes the key of links: it covers the transport's key and the choice of links. */
static uint64_t key_of(const struct kiln_transport *t, const struct kiln_links_header *header)
{
    struct kiln_links_header h = *header;
    h.runs = h.bytes = h.key = 0;
    return XXH3_64bits_withSeed(&h, sizeof h, t->key);
}

static struct kiln_links_header header_of(const struct kiln_transport *t, const struct kiln_link_choice *choice)
{
    struct kiln_links_header h = {
        .version = KILN_LINKS_VERSION, .samples = choice->samples, .error = choice->error, .points = t->points};
    memcpy(h.magic, KILN_LINKS_MAGIC, sizeof h.magic);
    h.key = key_of(t, &h);
    return h;
}

static int write_at(const struct link_file *f, const void *from, uint64_t bytes, uint64_t at, struct kiln_error *error)
{
    for (uint64_t done = 0; done < bytes;) {
        const ssize_t put =
            pwrite(f->descriptor, (const char *)from + done, (size_t)(bytes - done), (off_t)(at + done));
        if (put < 0 && errno == EINTR)
            continue;
        if (put < 0)
            return kiln_fail_errno(error, KILN_IO, "cannot write '%s'", f->path);
        done += (uint64_t)put;
    }
    return KILN_OK;
}

static int close_file(struct link_file *f, bool writes, struct kiln_error *error)
{
    int status = KILN_OK;
    if (f->descriptor >= 0 && writes && fdatasync(f->descriptor) != 0)
        status = kiln_fail_errno(error, KILN_IO, "cannot write '%s'", f->path);
    if (f->descriptor >= 0 && close(f->descriptor) != 0 && writes && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "cannot write '%s'", f->path);
    f->descriptor = -1;
    return status;
}

/* ---- writing ---- */

/* This rank's range of the file, and its place. */
struct rank_range {
    uint64_t runs, bytes;           /* of this rank */
    uint64_t first_run, first_byte; /* of all codes, behind the table */
    uint64_t all_runs, all_bytes;
};

/* Collective. */
static struct rank_range rank_range_of(MPI_Comm communicator, const struct kiln_surface *s,
                                       struct kiln_kept_links *const *kept)
{
    uint64_t own[2] = {s->tile_run_count, 0}, before[2] = {0, 0}, all[2];
    int rank;
    for (size_t i = 0; i < s->tile_run_count; i++)
        own[1] += kept[i] != NULL ? kept[i]->bytes : 0;
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Exscan(own, before, 2, MPI_UINT64_T, MPI_SUM, communicator);
    (void)MPI_Allreduce(own, all, 2, MPI_UINT64_T, MPI_SUM, communicator);
    if (rank == 0)
        before[0] = before[1] = 0;
    return (struct rank_range){own[0], own[1], before[0], before[1], all[0], all[1]};
}

/* Writes the table and codes of this rank's tile runs in the form of the file. */
static void lay_out(const struct kiln_surface *s, struct kiln_kept_links *const *kept,
                    const struct rank_range *rank_range, uint64_t key, struct kiln_links_entry *table, uint8_t *codes)
{
    uint64_t at = 0;
    const uint64_t begin = KILN_LINKS_BEGIN + rank_range->all_runs * sizeof *table + rank_range->first_byte;
    for (size_t i = 0; i < s->tile_run_count; i++) {
        const struct kiln_kept_links *k = kept[i];
        table[i] = (struct kiln_links_entry){.first = s->tile_runs[i].first.at};
        if (k == NULL)
            continue;
        table[i] = (struct kiln_links_entry){k->first, begin + at, k->bytes, k->links, check_of(k, key)};
        memcpy(codes + at, k->code, k->bytes);
        at += k->bytes;
    }
}

/* Not collective. */
static int write_rank_range(const struct link_file *f, const struct kiln_surface *s,
                            struct kiln_kept_links *const *kept, const struct rank_range *rank_range, uint64_t key,
                            struct kiln_error *error)
{
    static const char what[] = "the links that are kept";
    struct kiln_links_entry *table = NULL;
    uint8_t *codes = NULL;
    int status;
    KILN_TRY(kiln_allocate(&table, (size_t)rank_range->runs, sizeof *table, what, error));
    KILN_TRY(kiln_allocate(&codes, (size_t)rank_range->bytes, 1, what, error));
    lay_out(s, kept, rank_range, key, table, codes);
    KILN_TRY(write_at(f, table, rank_range->runs * sizeof *table,
                      KILN_LINKS_BEGIN + rank_range->first_run * sizeof *table, error));
    KILN_TRY(write_at(f, codes, rank_range->bytes,
                      KILN_LINKS_BEGIN + rank_range->all_runs * sizeof *table + rank_range->first_byte, error));
end:
    kiln_free(&table);
    kiln_free(&codes);
    return status;
}

/* Rank 0. Whether the file is there, and finished. */
static bool is_finished(const struct kiln_transport *t, const struct kiln_links_header *h)
{
    struct kiln_links_header there = {.samples = 0};
    int file;
    (void)kiln_openat_plain(t->folder, KILN_LINK_FILE, O_RDONLY, KILN_LINK_FILE, &file, NULL);
    const bool whole = file >= 0 && pread(file, &there, sizeof there, 0) == (ssize_t)sizeof there;
    if (file >= 0)
        (void)close(file);
    return whole && memcmp(&there, h, sizeof there) == 0;
}

/* Collective. Creates the file on rank 0; then the others open it. */
static int make_file(struct link_file *f, const struct kiln_transport *t, MPI_Comm communicator, uint64_t bytes,
                     struct kiln_error *error)
{
    int status = KILN_OK;
    for (int turn = 0; turn < 2 && status == KILN_OK; turn++) {
        const bool mine = (t->rank == 0) == (turn == 0);
        if (mine)
            status = kiln_openat_plain(t->folder, KILN_LINK_FILE, O_RDWR | (turn == 0 ? O_CREAT | O_TRUNC : 0), f->path,
                                       &f->descriptor, error);
        if (mine && status == KILN_OK && turn == 0 && ftruncate(f->descriptor, (off_t)bytes) != 0)
            status = kiln_fail_errno(error, KILN_IO, "cannot write '%s'", f->path);
        status = kiln_agree(communicator, status, error);
    }
    return status;
}

int kiln_link_file_write(const struct kiln_transport *t, MPI_Comm communicator, const struct kiln_surface *s,
                         struct kiln_kept_links *const *kept, const struct kiln_link_choice *choice,
                         struct kiln_error *error)
{
    const struct rank_range rank_range = rank_range_of(communicator, s, kept);
    struct kiln_links_header h = header_of(t, choice);
    struct link_file f;
    int finished;
    h.runs = rank_range.all_runs;
    h.bytes = KILN_LINKS_BEGIN + rank_range.all_runs * sizeof(struct kiln_links_entry) + rank_range.all_bytes;
    finished = t->rank == 0 && is_finished(t, &h);
    (void)MPI_Bcast(&finished, 1, MPI_INT, 0, communicator);
    if (finished != 0)
        return KILN_OK;
    name_file(&f, t);
    int status = make_file(&f, t, communicator, h.bytes, error);
    if (status == KILN_OK)
        status = kiln_agree(communicator, write_rank_range(&f, s, kept, &rank_range, h.key, error), error);
    if (status == KILN_OK && t->rank == 0)
        status = write_at(&f, &h, sizeof h, 0, error);
    const int closed = close_file(&f, true, status == KILN_OK ? error : NULL);
    return kiln_agree(communicator, status != KILN_OK ? status : closed, error);
}

/* ---- reading ---- */

static int refuse(const struct link_file *f, struct kiln_error *error)
{
    return kiln_fail(error, KILN_BAD_INPUT,
                     "'%s' is not as it was written, or of another bake; kiln verify says what else is damaged; "
                     "bake again with --keep-transport links",
                     f->path);
}

/* Opens the file; f->descriptor stays -1 where it is not there, or of another choice. */
static int open_file(struct link_file *f, const struct kiln_transport *t, const struct kiln_link_choice *choice,
                     struct kiln_links_header *h, struct kiln_error *error)
{
    struct stat file;
    struct kiln_links_header wanted = header_of(t, choice);
    int status = kiln_openat_plain(t->folder, KILN_LINK_FILE, O_RDONLY, f->path, &f->descriptor, error);
    if (status != KILN_OK)
        return status == KILN_NO_INPUT ? KILN_OK : status;
    if (fstat(f->descriptor, &file) != 0)
        return kiln_fail_errno(error, 0, "cannot read '%s'", f->path);
    status = kiln_links_read_at(f->descriptor, f->path, h, sizeof *h, 0, error);
    if (status != KILN_OK)
        return status;
    wanted.runs = h->runs;
    wanted.bytes = h->bytes;
    if (h->key == key_of(t, h) && h->version == wanted.version &&
        (h->samples != wanted.samples || h->error != wanted.error)) {
        (void)close(f->descriptor);
        f->descriptor = -1;
        return KILN_OK;
    }
    if (memcmp(h, &wanted, sizeof wanted) != 0 || (uint64_t)file.st_size != h->bytes || h->runs > h->points ||
        h->bytes < KILN_LINKS_BEGIN + h->runs * sizeof(struct kiln_links_entry))
        return refuse(f, error);
    return KILN_OK;
}

/* Finds the first entry of the table whose point is not before `first`. */
static uint64_t find_entry(const struct kiln_links_entry *table, uint64_t runs, uint64_t first)
{
    uint64_t low = 0, high = runs;
    while (low < high) {
        const uint64_t middle = low + (high - low) / 2;
        if (table[middle].first < first)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static int read_run(const struct link_file *f, const struct kiln_links_header *h, const struct kiln_links_entry *e,
                    const struct kiln_tile_run *run, struct kiln_kept_links **kept, struct kiln_error *error)
{
    struct kiln_kept_links *k = NULL;
    if (e->offset > h->bytes || e->bytes > h->bytes - e->offset)
        return refuse(f, error);
    int status;
    KILN_TRY(kiln_allocate(&k, sizeof *k + e->bytes, 1, "the links of a tile", error));
    *k = (struct kiln_kept_links){
        .first = e->first, .points = run->count, .bytes = e->bytes, .links = e->links, .of_file = 1};
    KILN_TRY(kiln_links_read_at(f->descriptor, f->path, k->code, e->bytes, e->offset, error));
    if (check_of(k, h->key) != e->check || kiln_links_check(k, h->points, NULL) != KILN_OK)
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT,
                           "'%s' is not as it was written: the links of the surface points from %llu on are damaged; "
                           "bake again with --keep-transport links",
                           f->path, (unsigned long long)e->first));
end:
    if (status == KILN_OK)
        *kept = k;
    else
        kiln_free(&k);
    return status;
}

static int read_runs(const struct link_file *f, const struct kiln_links_header *h, const struct kiln_surface *s,
                     struct kiln_kept_links **kept, uint64_t *read, struct kiln_error *error)
{
    struct kiln_links_entry *table = NULL;
    int status = kiln_allocate(&table, (size_t)h->runs, sizeof *table, "the links that are kept", error);
    if (status == KILN_OK)
        status = kiln_links_read_at(f->descriptor, f->path, table, h->runs * sizeof *table, KILN_LINKS_BEGIN, error);
    uint64_t at = status == KILN_OK && s->tile_run_count > 0 ? find_entry(table, h->runs, s->tile_runs[0].first.at) : 0;
    for (size_t i = 0; i < s->tile_run_count && status == KILN_OK; i++) {
        while (at < h->runs && table[at].first < s->tile_runs[i].first.at)
            at++;
        if (kept[i] != NULL || at == h->runs || table[at].first != s->tile_runs[i].first.at || table[at].bytes == 0)
            continue;
        status = read_run(f, h, &table[at], &s->tile_runs[i], &kept[i], error);
        *read += status == KILN_OK ? kept[i]->links : 0;
    }
    kiln_free(&table);
    return status;
}

int kiln_link_file_read(const struct kiln_transport *t, const struct kiln_surface *s, struct kiln_kept_links **kept,
                        const struct kiln_link_choice *choice, uint64_t *read, struct kiln_error *error)
{
    struct kiln_links_header h;
    struct link_file f;
    *read = 0;
    name_file(&f, t);
    int status = open_file(&f, t, choice, &h, error);
    if (status == KILN_OK && f.descriptor >= 0)
        status = read_runs(&f, &h, s, kept, read, error);
    (void)close_file(&f, false, NULL);
    return status;
}

uint64_t kiln_link_file_bytes_expected(uint64_t points, double link_error)
{
    return KILN_LINKS_BEGIN + points / KILN_TILE_TEXELS * sizeof(struct kiln_links_entry) +
           (uint64_t)((double)points * kiln_links_point_bytes(points, link_error));
}
