#include "coordinator/integrate/relight/transport.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "coordinator/files/plain_file.h"
#include "coordinator/mpi/agree.h"
#include "worker/backend/extended.h"
#include "worker/base/memory.h"
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

void kiln_transport_chains_name(const struct kiln_step *step, char name[KILN_TRANSPORT_NAME])
{
    (void)snprintf(name, KILN_TRANSPORT_NAME, "chains-%u-%u", step->stream, step->first_sample);
}

/* Words of a stream for each ray, of all rays of a step: in the dining room 0.48, with the door ajar 0.49. */
#define STREAM_WORDS 0.5

uint64_t kiln_transport_bytes(uint64_t points, uint32_t samples, bool has_chains)
{
    const double streams = 4.0 * STREAM_WORDS * (double)points * (double)samples;
    return kiln_rows_file_bytes(points, samples) + (has_chains ? kiln_row_chain_offset(points) + (uint64_t)streams : 0);
}

/* The file of a rank's own streams. */
static void name_spool(const struct kiln_step *step, uint32_t rank, char name[KILN_TRANSPORT_NAME])
{
    (void)snprintf(name, KILN_TRANSPORT_NAME, "chains-%u-%u-%u", step->stream, step->first_sample, rank);
}

bool kiln_transport_is_spool(const char *name)
{
    uint32_t of[3];
    return sscanf(name, "chains-%u-%u-%u", &of[0], &of[1], &of[2]) == 3;
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

/* Creates the file at its full length. All ranks do so; repeated calls change nothing. */
static int make_file(struct kiln_transport *t, const char *name, const struct kiln_rows_header *h,
                     struct kiln_error *error)
{
    const int status = kiln_openat_plain(t->folder, name, O_RDWR | O_CREAT, t->path, &t->rows.file, error);
    if (status != KILN_OK)
        return status;
    if (ftruncate(t->rows.file, (off_t)kiln_rows_file_bytes(h->points, h->samples)) != 0)
        return kiln_fail_errno(error, KILN_IO, "cannot write '%s'", t->path);
    if (t->rank == 0 && pwrite(t->rows.file, h, sizeof *h, 0) != (ssize_t)sizeof *h)
        return kiln_fail_errno(error, KILN_IO, "cannot write '%s'", t->path);
    return KILN_OK;
}

/* Opens the file. rows.file stays -1 if it does not exist, or has other samples. */
static int open_file(struct kiln_transport *t, const char *name, const struct kiln_rows_header *h,
                     struct kiln_error *error)
{
    struct kiln_rows_header there;
    struct stat file;
    const int status = kiln_openat_plain(t->folder, name, O_RDONLY, t->path, &t->rows.file, error);
    if (status != KILN_OK)
        return status == KILN_NO_INPUT ? KILN_OK : status;
    if (fstat(t->rows.file, &file) != 0)
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

/* ---- chains ---- */

static uint64_t records_end(const struct kiln_transport *t) { return kiln_row_chain_offset(t->points); }

static struct kiln_rows_header chains_header(const struct kiln_rows_header *rows)
{
    struct kiln_rows_header h = *rows;
    memcpy(h.magic, KILN_ROW_CHAINS_MAGIC, sizeof h.magic);
    return h;
}

/* Creates the file of records at its full length, and opens this rank's own file of streams for appending. */
static int make_chains(struct kiln_transport *t, const struct kiln_step *step, const char *name,
                       const struct kiln_rows_header *h, struct kiln_error *error)
{
    char spool[KILN_TRANSPORT_NAME];
    struct stat file;
    struct kiln_row_chains *c = &t->chains;
    name_spool(step, (uint32_t)t->rank, spool);
    c->number = (uint32_t)t->rank;
    int status = kiln_openat_plain(t->folder, name, O_RDWR | O_CREAT, t->chains_path, &c->file, error);
    if (status == KILN_OK)
        status = kiln_openat_plain(t->folder, spool, O_RDWR | O_CREAT, t->chains_path, &c->spool, error);
    if (status != KILN_OK)
        return status;
    if (fstat(c->file, &file) != 0 ||
        ((uint64_t)file.st_size < records_end(t) && ftruncate(c->file, (off_t)records_end(t)) != 0) ||
        (t->rank == 0 && pwrite(c->file, h, sizeof *h, 0) != (ssize_t)sizeof *h) || fstat(c->spool, &file) != 0)
        return kiln_fail_errno(error, KILN_IO, "cannot write '%s'", t->chains_path);
    c->spool_words = ((uint64_t)file.st_size + 3) / 4;
    return KILN_OK;
}

static int open_chains(struct kiln_transport *t, const char *name, const struct kiln_rows_header *h,
                       struct kiln_error *error)
{
    struct kiln_rows_header there;
    struct stat file;
    struct kiln_row_chains *c = &t->chains;
    const int status = kiln_openat_plain(t->folder, name, O_RDONLY, t->chains_path, &c->file, error);
    if (status != KILN_OK)
        return status;
    if (fstat(c->file, &file) != 0)
        return kiln_fail_errno(error, 0, "cannot read '%s'", t->chains_path);
    if (pread(c->file, &there, sizeof there, 0) != (ssize_t)sizeof there || memcmp(&there, h, sizeof there) != 0 ||
        (uint64_t)file.st_size < records_end(t) || ((uint64_t)file.st_size - records_end(t)) % 4 != 0)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "'%s' is not as it was written, or of another bake; kiln verify says what else is damaged; "
                         "bake again with --keep-transport rows",
                         t->chains_path);
    c->words_begin = records_end(t);
    c->words = ((uint64_t)file.st_size - c->words_begin) / 4;
    return KILN_OK;
}

/* Opens the chains of a step whose rows are open, or makes them. */
static int begin_chains(struct kiln_transport *t, const struct kiln_step *step, const struct kiln_rows_header *rows,
                        struct kiln_error *error)
{
    char name[KILN_TRANSPORT_NAME];
    const struct kiln_rows_header h = chains_header(rows);
    if (!t->has_chains || t->rows.file < 0)
        return KILN_OK;
    kiln_transport_chains_name(step, name);
    (void)snprintf(t->chains_path, sizeof t->chains_path, "%s/%s", t->directory, name);
    t->chains = (struct kiln_row_chains){.file = -1, .spool = -1, .path = t->chains_path};
    t->rows.chains = &t->chains;
    return t->replays ? open_chains(t, name, &h, error) : make_chains(t, step, name, &h, error);
}

static int end_chains(struct kiln_transport *t, struct kiln_error *error)
{
    const int files[] = {t->chains.spool, t->chains.file};
    int status = KILN_OK;
    for (size_t i = 0; i < 2 && t->rows.chains != NULL; i++) {
        if (files[i] >= 0 && !t->replays && fdatasync(files[i]) != 0)
            status = kiln_fail_errno(error, KILN_IO, "cannot write '%s'", t->chains_path);
        if (files[i] >= 0 && close(files[i]) != 0 && status == KILN_OK && !t->replays)
            status = kiln_fail_errno(error, KILN_IO, "cannot write '%s'", t->chains_path);
    }
    return status;
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
    int status;
    KILN_TRY(t->replays ? open_file(t, name, &h, error) : make_file(t, name, &h, error));
    KILN_TRY(begin_chains(t, step, &h, error));
    if (t->rows.file >= 0)
        kiln_backend_set_rows(backend, &t->rows);
end:
    return status;
}

int kiln_transport_end(struct kiln_transport *t, struct kiln_backend *backend, struct kiln_error *error)
{
    int status = KILN_OK;
    if (!t->is_on || t->rows.path == NULL)
        return KILN_OK;
    kiln_backend_set_rows(backend, NULL);
    status = end_chains(t, error);
    if (t->rows.file >= 0 && status == KILN_OK && !t->replays && fdatasync(t->rows.file) != 0)
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

/* ---- packing chains ---- */

/* One rank's part of it. */
struct packing {
    const struct kiln_transport *t;
    const struct kiln_step *step;
    int file, spool; /* spool: open file of streams of rank `number` */
    uint32_t number;
    uint64_t at; /* where the next stream goes, in words behind the records */
    uint32_t *words;
    size_t room;
};

static int write_all(int file, const char *path, const void *from, uint64_t bytes, uint64_t at,
                     struct kiln_error *error)
{
    for (uint64_t done = 0; done < bytes;) {
        const ssize_t put = pwrite(file, (const char *)from + done, (size_t)(bytes - done), (off_t)(at + done));
        if (put < 0 && errno != EINTR)
            return kiln_fail_errno(error, KILN_IO, "cannot write '%s'", path);
        done += put > 0 ? (uint64_t)put : 0;
    }
    return KILN_OK;
}

static int open_spool(struct packing *p, uint32_t number, struct kiln_error *error)
{
    char name[KILN_TRANSPORT_NAME];
    if (p->spool >= 0 && p->number == number)
        return KILN_OK;
    if (p->spool >= 0)
        (void)close(p->spool);
    name_spool(p->step, number, name);
    p->number = number;
    const int status = kiln_openat_plain(p->t->folder, name, O_RDONLY, p->t->chains_path, &p->spool, error);
    return status == KILN_NO_INPUT ? KILN_IO : status; /* this bake wrote it */
}

enum { RECORDS = 4096 }; /* that are read at a time */

/* Moves the streams of `count` records. A stream that an interrupted run has already moved is read again from its
 * rank's file, which is kept until all are moved. */
static int pack_records(struct packing *p, struct kiln_row_chain *records, uint64_t count, struct kiln_error *error)
{
    int status = KILN_OK;
    for (uint64_t i = 0; i < count && status == KILN_OK; i++) {
        struct kiln_row_chain *r = &records[i];
        const uint64_t bytes = r->words * sizeof *p->words;
        if (r->check != 0 && r->spool != KILN_CHAIN_PACKED && r->words > 0) {
            status = kiln_grow(&p->words, &p->room, (size_t)r->words, sizeof *p->words, "kept chains", error);
            if (status == KILN_OK)
                status = open_spool(p, r->spool, error);
            if (status == KILN_OK)
                status = read_all(p->spool, p->t->chains_path, p->words, bytes, r->at * sizeof *p->words, error);
            if (status == KILN_OK)
                status = write_all(p->file, p->t->chains_path, p->words, bytes,
                                   records_end(p->t) + p->at * sizeof *p->words, error);
        }
        if (r->check != 0) {
            r->spool = KILN_CHAIN_PACKED;
            r->at = p->at;
            p->at += r->words;
        }
    }
    return status;
}

/* Walks the records of the rank's points: counts the words of their streams, and with `moves` moves these. */
static int walk_records(struct packing *p, uint64_t first, uint64_t count, bool moves, uint64_t *words,
                        struct kiln_error *error)
{
    struct kiln_row_chain *records = NULL;
    int status = kiln_allocate(&records, RECORDS, sizeof *records, "the records of chains", error);
    for (uint64_t i = 0; i < count && status == KILN_OK; i += RECORDS) {
        const uint64_t some = count - i < RECORDS ? count - i : RECORDS, at = kiln_row_chain_offset(first + i);
        status = read_all(p->file, p->t->chains_path, records, some * sizeof *records, at, error);
        for (uint64_t k = 0; k < some && status == KILN_OK; k++)
            *words += records[k].words;
        if (status == KILN_OK && moves)
            status = pack_records(p, records, some, error);
        if (status == KILN_OK && moves)
            status = write_all(p->file, p->t->chains_path, records, some * sizeof *records, at, error);
    }
    kiln_free(&records);
    return status;
}

int kiln_transport_pack(struct kiln_transport *t, MPI_Comm communicator, const struct kiln_step *step,
                        struct kiln_error *error)
{
    char name[KILN_TRANSPORT_NAME];
    int ranks;
    uint64_t words = 0, before = 0, again = 0;
    struct packing p = {.t = t, .step = step, .spool = -1};
    (void)MPI_Comm_size(communicator, &ranks);
    const uint64_t rank = (uint64_t)t->rank, first = t->points * rank / (uint64_t)ranks,
                   count = t->points * (rank + 1) / (uint64_t)ranks - first;
    kiln_transport_chains_name(step, name);
    (void)snprintf(t->chains_path, sizeof t->chains_path, "%s/%s", t->directory, name);
    int status = kiln_openat_plain(t->folder, name, O_RDWR, t->chains_path, &p.file, error);
    status = status == KILN_NO_INPUT ? KILN_IO : status;
    if (status == KILN_OK)
        status = walk_records(&p, first, count, false, &words, error);
    status = kiln_agree(communicator, status, error);
    (void)MPI_Exscan(&words, &before, 1, MPI_UINT64_T, MPI_SUM, communicator);
    p.at = rank == 0 ? 0 : before;
    if (status == KILN_OK)
        status = walk_records(&p, first, count, true, &again, error);
    if (status == KILN_OK && fdatasync(p.file) != 0)
        status = kiln_fail_errno(error, KILN_IO, "cannot write '%s'", t->chains_path);
    if (p.spool >= 0)
        (void)close(p.spool);
    if (p.file >= 0)
        (void)close(p.file);
    kiln_free(&p.words);
    return kiln_agree(communicator, status, error);
}
