#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>
#include <xxhash.h>

#include "coordinator/run/checkpoint_private.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/assert_same.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

static double free_bytes(const char *path)
{
    struct statvfs found;
    return statvfs(path, &found) == 0 ? (double)found.f_bavail * (double)found.f_frsize : -1.0;
}

static int make_room(const char *place, uint64_t bytes, struct kiln_error *error)
{
    const double needed =
        1.2 * (double)bytes + 16384.0; /* the constant is for the manifest, the status file and folders */
    double there = free_bytes(place);
    if (there >= 0.0 && there < needed) {
        uint64_t *generations = NULL;
        size_t count = 0;
        int status = checkpoint_list(place, false, &generations, &count, error);
        for (size_t i = count; status == KILN_OK && i-- > 1;)
            checkpoint_remove_generation(place, false, generations[i]);
        kiln_free(&generations);
        if (status != KILN_OK)
            return status;
        there = free_bytes(place);
    }
    if (there >= 0.0 && there < needed)
        return kiln_fail(
            error, KILN_IO,
            "the disk of '%s' has %.3f MB left and a checkpoint needs %.3f MB: make room and run the same command "
            "again; the last checkpoint is whole",
            place, there * 1e-6, needed * 1e-6);
    return KILN_OK;
}

int checkpoint_begin(const char *place, bool first, uint64_t bytes, uint64_t generation, struct kiln_error *error)
{
    struct kiln_folder folder;
    int status = kiln_folder_open(&folder, place, "checkpoint", true, error);
    kiln_folder_close(&folder);
    if (status == KILN_OK && first) { /* sync the entry of the folder of all generations, too */
        status = kiln_folder_open(&folder, place, NULL, false, error);
        if (status == KILN_OK)
            status = kiln_folder_sync(&folder, error);
        kiln_folder_close(&folder);
    }
    if (status == KILN_OK)
        status = make_room(place, bytes, error);
    if (status == KILN_OK) {
        checkpoint_remove_generation(place, true, generation);
        status = checkpoint_open_generation(&folder, place, true, generation, true, error);
        kiln_folder_close(&folder);
    }
    return status;
}

static uint64_t sum_bytes(const struct kiln_array_range *blocks, size_t count)
{
    uint64_t bytes = 0;
    for (size_t i = 0; i < count; i++)
        bytes += blocks[i].count * blocks[i].size;
    return bytes;
}

/* Hashes and writes one megabyte at a time, so that it is read from memory only once. */
static int write_array(int descriptor, XXH3_state_t *hash, const struct kiln_array_range *block, uint64_t offset,
                       const char *path, struct kiln_error *error)
{
    enum { STEP = 1 << 20 };
    const char *bytes = block->data;
    const uint64_t size = block->count * block->size;
    int status = KILN_OK;
    for (uint64_t at = 0; at < size && status == KILN_OK; at += STEP) {
        const size_t step = (size_t)(size - at < STEP ? size - at : STEP);
        (void)XXH3_128bits_update(hash, bytes + at, step);
        status = kiln_write_all(descriptor, bytes + at, step, (size_t)(offset + at), path, error);
    }
    return status;
}

static int write_part(const struct kiln_checkpoint *c, uint64_t generation, const struct kiln_array_range *blocks,
                      size_t count, struct checkpoint_file *part, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], name[CHECKPOINT_NAME];
    int descriptor = -1;
    XXH3_state_t *hash = XXH3_createState();
    checkpoint_file_name(name, true, generation, (size_t)c->rank);
    int status = hash == NULL ? kiln_fail(error, KILN_SYSTEM, "out of memory: a checkpoint's hash") : KILN_OK;
    if (status == KILN_OK)
        status = kiln_path_join(path, c->place, name, error);
    if (status == KILN_OK)
        status = kiln_open_below(c->place, name, O_WRONLY | O_CREAT | O_EXCL, 0666, &descriptor, error);
    if (status == KILN_NO_INPUT)
        status = KILN_CANNOT_CREATE;
    if (status == KILN_OK)
        (void)XXH3_128bits_reset(hash);
    for (size_t i = 0; i < count && status == KILN_OK; i++) {
        struct checkpoint_array *b = &part->blocks[part->array_count++];
        *b = (struct checkpoint_array){
            .first = blocks[i].first, .count = blocks[i].count, .size = blocks[i].size, .offset = part->bytes};
        memcpy(b->name, blocks[i].name, sizeof b->name);
        status = write_array(descriptor, hash, &blocks[i], part->bytes, path, error);
        part->bytes += b->count * b->size;
    }
    if (status == KILN_OK && kiln_fsync(descriptor) != 0)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be synced to disk", path);
    if (descriptor >= 0 && kiln_close(descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be closed", path);
    if (status == KILN_OK) {
        const XXH128_hash_t value = XXH3_128bits_digest(hash);
        kiln_hash_text(value.high64, value.low64, part->hash);
    }
    (void)XXH3_freeState(hash);
    return status;
}

static json_t *part_json(const struct checkpoint_file *part)
{
    json_t *blocks = json_array();
    for (uint32_t i = 0; i < part->array_count; i++) {
        const struct checkpoint_array *b = &part->blocks[i];
        json_array_append_new(blocks, json_pack("[s,I,I,I,I]", b->name, (json_int_t)b->first, (json_int_t)b->count,
                                                (json_int_t)b->size, (json_int_t)b->offset));
    }
    return json_pack("{s:I, s:s, s:o}", "bytes", (json_int_t)part->bytes, "xxh3_128", part->hash, "blocks", blocks);
}

/* Rank 0: creates the manifest. */
static json_t *manifest_json(const json_t *identity, uint64_t generation, const struct checkpoint_file *parts,
                             size_t count)
{
    static const char *const order = __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__ ? "little" : "big";
    struct timespec now;
    (void)clock_gettime(CLOCK_REALTIME, &now);
    json_t *files = json_array();
    for (size_t i = 0; i < count; i++)
        json_array_append_new(files, part_json(&parts[i]));
    return json_pack("{s:s, s:i, s:s, s:s, s:I, s:f, s:O, s:o}", "file", "kiln checkpoint", "format",
                     KILN_CHECKPOINT_FORMAT, "kiln", KILN_VERSION, "byte_order", order, "generation",
                     (json_int_t)generation, "written", (double)now.tv_sec + 1e-9 * (double)now.tv_nsec, "identity",
                     (json_t *)(uintptr_t)identity, "parts", files);
}

int checkpoint_publish(const char *place, uint64_t generation, const char *manifest, size_t size,
                       struct kiln_error *error)
{
    char name[CHECKPOINT_NAME];
    uint64_t *generations = NULL;
    size_t count = 0;
    checkpoint_manifest_name(name, true, generation);
    int status;
    KILN_TRY(kiln_publish_bytes_below(place, name, manifest, size, error));
    KILN_TRY(checkpoint_publish_generation(place, generation, error));
    if (checkpoint_list(place, false, &generations, &count, NULL) == KILN_OK)
        for (size_t i = 2; i < count; i++)
            checkpoint_remove_generation(place, false, generations[i]);
end:
    kiln_free(&generations);
    return status;
}

/* Text of a manifest; all ranks that write to disks of their own need it. */
struct manifest_text {
    char *text;
    size_t size;
};

/* Collective: gathers the tables of all files, and makes a manifest from them. */
static int gather_manifest(const struct kiln_checkpoint *c, uint64_t generation, const json_t *identity,
                           const struct checkpoint_file *own, struct manifest_text *m, struct kiln_error *error)
{
    struct checkpoint_file *parts = NULL;
    int status = KILN_OK;
    if (c->rank == 0)
        status = kiln_allocate(&parts, (size_t)c->ranks, sizeof *parts, "a checkpoint's manifest", error);
    status = kiln_agree(c->communicator, status, error);
    if (status != KILN_OK)
        return status;
    (void)MPI_Gather(own, (int)sizeof *own, MPI_BYTE, parts, (int)sizeof *own, MPI_BYTE, 0, c->communicator);
    if (c->rank == 0) {
        json_t *json = manifest_json(identity, generation, parts, (size_t)c->ranks);
        status = kiln_seal(json, JSON_COMPACT, &m->text, &m->size, "a checkpoint's manifest", error);
        json_decref(json);
    }
    kiln_free(&parts);
    status = kiln_agree(c->communicator, status, error);
    uint64_t size = m->size;
    if (c->local == NULL || status != KILN_OK)
        return status;
    (void)MPI_Bcast(&size, 1, MPI_UINT64_T, 0, c->communicator);
    if (c->rank != 0)
        status = kiln_allocate(&m->text, (size_t)size + 1, 1, "a checkpoint's manifest", error);
    m->size = (size_t)size;
    status = kiln_agree(c->communicator, status, error);
    if (status == KILN_OK)
        (void)MPI_Bcast(m->text, (int)size, MPI_BYTE, 0, c->communicator);
    return status;
}

/* Collective: writes a generation at c->place, by all ranks into one folder or by each into its own. */
static int write_generation(struct kiln_checkpoint *c, uint64_t generation, const json_t *identity,
                            const struct kiln_array_range *blocks, size_t array_count, uint64_t bytes,
                            struct manifest_text *m, struct kiln_error *error)
{
    const bool leads = c->rank == 0 || c->local != NULL;
    struct checkpoint_file *own = NULL;
    int status = kiln_allocate(&own, 1, sizeof *own, "a checkpoint's table of arrays", error);
    if (status == KILN_OK && leads)
        status = checkpoint_begin(c->place, c->written == 0, bytes, generation, error);
    status = kiln_agree(c->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_agree(c->communicator, write_part(c, generation, blocks, array_count, own, error), error);
    if (status == KILN_OK)
        status = gather_manifest(c, generation, identity, own, m, error);
    if (status == KILN_OK && leads)
        status = checkpoint_publish(c->place, generation, m->text, m->size, error);
    status = kiln_agree(c->communicator, status, error);
    if (status != KILN_OK && leads)
        checkpoint_remove_generation(c->place, true, generation);
    if (status != KILN_OK && c->local != NULL) /* another rank's is not whole */
        checkpoint_remove_generation(c->place, false, generation);
    kiln_free(&own);
    return status;
}

int kiln_checkpoint_write(struct kiln_checkpoint *c, const json_t *identity, const struct kiln_array_range *blocks,
                          size_t array_count, struct kiln_error *error)
{
    const double start = MPI_Wtime();
    const uint64_t generation = c->newest + 1;
    const uint64_t bytes = sum_bytes(blocks, array_count);
    uint64_t all = 0;
    struct manifest_text m = {.text = NULL};
    kiln_assert_same(c->communicator, generation, "the number of a checkpoint");
    kiln_assert_same_json(c->communicator, identity, "the identity of a bake");
    (void)MPI_Allreduce(&bytes, &all, 1, MPI_UINT64_T, MPI_SUM, c->communicator);
    int status;
    KILN_TRY(c->local != NULL ? checkpoint_local_begin(c, error) : KILN_OK);
    KILN_TRY(write_generation(c, generation, identity, blocks, array_count, c->local != NULL ? bytes : all, &m, error));
    if (c->local != NULL)
        checkpoint_local_copy(c, generation, all, m.text, m.size);
    c->newest = generation;
    c->written++;
    c->last_bytes = all;
end:
    c->seconds += MPI_Wtime() - start;
    kiln_free(&m.text);
    return status;
}

uint64_t kiln_checkpoint_last(const struct kiln_checkpoint *c) { return c->written > 0 ? c->newest : c->generation; }

void kiln_checkpoint_spent(const struct kiln_checkpoint *c, uint64_t *count, double *seconds, uint64_t *bytes)
{
    *count = c->written;
    *seconds = c->seconds;
    *bytes = c->last_bytes;
}
