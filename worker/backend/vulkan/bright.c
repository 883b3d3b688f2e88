#include "worker/backend/vulkan/bright.h"

#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"

enum { CLUSTER = 16 }; /* points in a cluster; about half of them exist */

static const char WHAT[] = "the bright patches";

static size_t real_bytes(const struct vulkan_backend *b) { return b->float64 ? sizeof(double) : sizeof(float); }

/* Writes numbers as the kernels' `real`. */
static void put_reals(const struct vulkan_backend *b, void *to, const double *from, size_t count)
{
    if (b->float64) {
        memcpy(to, from, count * sizeof *from);
        return;
    }
    for (size_t i = 0; i < count; i++)
        ((float *)to)[i] = (float)from[i];
}

/* ---- what stays for a call ---- */

static int bring(struct vulkan_backend *b, int which, const void *data, size_t bytes, struct kiln_error *error)
{
    struct gpu_buffer *buffer = &b->bright[which];
    const int status = vulkan_grow_buffer(b, buffer, bytes, GPU_DEVICE, WHAT, error);
    return status == KILN_OK && bytes > 0 ? gpu_upload(b->gpu, buffer, 0, data, bytes, error) : status;
}

static int bring_clusters(struct vulkan_backend *b, const struct kiln_bright *bright, struct kiln_error *error)
{
    uint32_t *ranges = NULL;
    double *power = NULL;
    int status;
    KILN_TRY(kiln_allocate(&ranges, 2 * (size_t)bright->count, sizeof *ranges, WHAT, error));
    KILN_TRY(kiln_allocate(&power, 2 * (size_t)bright->count, sizeof *power, WHAT, error));
    for (uint32_t c = 0; c < bright->count; c++) {
        ranges[2 * c] = bright->clusters[c].first;
        ranges[2 * c + 1] = bright->clusters[c].end;
        power[c] = bright->clusters[c].power;
    }
    KILN_TRY(bring(b, VULKAN_BRIGHT_CLUSTERS, ranges, 2 * (size_t)bright->count * sizeof *ranges, error));
    put_reals(b, power + bright->count, power, bright->count);
    KILN_TRY(bring(b, VULKAN_BRIGHT_CLUSTER_POWER, power + bright->count, bright->count * real_bytes(b), error));
end:
    kiln_free(&ranges);
    kiln_free(&power);
    return status;
}

static int bring_points(struct vulkan_backend *b, const struct kiln_bright *bright, struct kiln_error *error)
{
    const size_t count = (size_t)b->surface->point_count;
    struct kiln_gpu_bright_patch *patches = NULL;
    double *power = NULL;
    int status;
    KILN_TRY(kiln_allocate(&patches, count, sizeof *patches, WHAT, error));
    KILN_TRY(kiln_allocate(&power, count, sizeof *power, WHAT, error));
    for (size_t i = 0; i < count; i++) {
        const struct kiln_patch *p = &bright->points[i];
        patches[i] = (struct kiln_gpu_bright_patch){p->place, p->edge_s, p->edge_t, p->normal};
        const double one = (double)bright->power[i];
        put_reals(b, (char *)power + i * real_bytes(b), &one, 1);
    }
    KILN_TRY(bring(b, VULKAN_BRIGHT_PATCHES, patches, count * sizeof *patches, error));
    KILN_TRY(bring(b, VULKAN_BRIGHT_POWER, power, count * real_bytes(b), error));
end:
    kiln_free(&patches);
    kiln_free(&power);
    return status;
}

int vulkan_bright_prepare(struct vulkan_backend *b, const struct kiln_bright *bright, struct kiln_error *error)
{
    const size_t bytes = (size_t)b->surface->point_count * sizeof *bright->members;
    const uint32_t members = bright->count > 0 ? bright->clusters[bright->count - 1].end : 0;
    int status;
    KILN_TRY(bring_clusters(b, bright, error));
    KILN_TRY(bring_points(b, bright, error));
    KILN_TRY(bring(b, VULKAN_BRIGHT_MEMBERS, bright->members, members * sizeof *bright->members, error));
    KILN_TRY(bring(b, VULKAN_BRIGHT_CLUSTER_OF, bright->cluster_of, bytes, error));
end:
    return status;
}

void vulkan_bright_release(struct vulkan_backend *b)
{
    for (int i = 0; i < VULKAN_BRIGHT_ARRAYS; i++)
        gpu_buffer_destroy(b->gpu, &b->bright[i]);
}

/* ---- what goes with a chunk ---- */

/* The receivers of a chunk. */
struct receivers {
    const struct kiln_bright *bright;
    uint32_t points, count, rows;
    uint32_t *of;     /* of each point */
    uint32_t *number; /* number of each cluster; KILN_GPU_NONE: no existing points. The last is for points in none */
    struct kiln_bright_receiver *all; /* `count` */
    uint32_t *row;                    /* of each */
    double *sums;                     /* of all */
    struct kiln_arena arena;
};

static void receivers_release(struct receivers *r)
{
    kiln_arena_release(&r->arena);
    kiln_free(&r->sums);
}

/* Numbers the clusters of points, in the order of first occurrence. */
static void number_receivers(struct receivers *r, const uint32_t *cluster_of)
{
    memset(r->number, 0xff, (r->bright->count + (size_t)1) * sizeof *r->number);
    for (uint32_t i = 0; i < r->points; i++) {
        const uint32_t cluster = cluster_of[i] != KILN_NO_CLUSTER ? cluster_of[i] : r->bright->count;
        if (r->number[cluster] == KILN_GPU_NONE) {
            r->number[cluster] = r->count;
            r->all[r->count++].cluster = cluster_of[i];
        }
        r->of[i] = r->number[cluster];
    }
}

static int begin_receivers(struct receivers *r, const struct vulkan_backend *b, uint32_t samples,
                           struct kiln_error *error)
{
    const size_t clusters = r->bright->count;
    int status = kiln_allocate(&r->sums, r->count * clusters, sizeof *r->sums, WHAT, error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&r->arena, &r->row, r->count, sizeof *r->row, WHAT, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)b->all_threads) schedule(dynamic)
    for (uint32_t i = 0; i < r->count; i++) {
        r->all[i].sums = r->sums + i * clusters;
        kiln_bright_begin(r->bright, samples, &r->all[i]);
    }
    for (uint32_t i = 0; i < r->count; i++)
        r->row[i] = r->all[i].share > 0.0 ? r->rows++ : 0;
    return KILN_OK;
}

static int make_receivers(struct receivers *r, const struct vulkan_backend *b, const struct kiln_batch *batch,
                          const struct vulkan_chunk *chunk, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->of, r->points, sizeof *r->of, WHAT, error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->number, r->bright->count + (size_t)1, sizeof *r->number, WHAT, error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->all, r->points, sizeof *r->all, WHAT, error));
end:
    if (status != KILN_OK)
        return status;
    number_receivers(r, r->bright->cluster_of + b->surface->tile_runs[chunk->tile_run_first].first.at);
    return begin_receivers(r, b, batch->samples, error);
}

/* Offsets of the parts of a chunk's data: after struct kiln_gpu_bright, all multiples of 8 bytes. */
static size_t sums_at(void) { return sizeof(struct kiln_gpu_bright); }
static size_t receivers_at(const struct receivers *r, const struct vulkan_backend *b)
{
    return sums_at() + ((size_t)r->rows * r->bright->count * real_bytes(b) + 7) / 8 * 8;
}
static size_t numbers_at(const struct receivers *r, const struct vulkan_backend *b)
{
    return receivers_at(r, b) + r->count * sizeof(struct kiln_gpu_bright_receiver);
}

static void write_chunk(const struct receivers *r, const struct vulkan_backend *b, double scale,
                        const struct vulkan_slot *slot)
{
    char *to = slot->guides_host.mapped;
    const uint64_t at = slot->guides.address;
    struct kiln_gpu_bright_receiver *of = (void *)(to + receivers_at(r, b));
    *(struct kiln_gpu_bright *)(void *)to =
        (struct kiln_gpu_bright){.clusters = b->bright[VULKAN_BRIGHT_CLUSTERS].address,
                                 .cluster_power = b->bright[VULKAN_BRIGHT_CLUSTER_POWER].address,
                                 .members = b->bright[VULKAN_BRIGHT_MEMBERS].address,
                                 .cluster_of = b->bright[VULKAN_BRIGHT_CLUSTER_OF].address,
                                 .power = b->bright[VULKAN_BRIGHT_POWER].address,
                                 .patches = b->bright[VULKAN_BRIGHT_PATCHES].address,
                                 .receiver_of = at + numbers_at(r, b),
                                 .receivers = at + receivers_at(r, b),
                                 .sums = at + sums_at(),
                                 .count = r->bright->count,
                                 .scale = (float)scale};
    memcpy(to + numbers_at(r, b), r->of, r->points * sizeof *r->of);
    for (uint32_t i = 0; i < r->count; i++) {
        of[i] = (struct kiln_gpu_bright_receiver){r->all[i].by_cosine, r->row[i]};
        if (r->all[i].share > 0.0)
            put_reals(b, to + sums_at() + (size_t)r->row[i] * r->bright->count * real_bytes(b), r->all[i].sums,
                      r->bright->count);
    }
}

int vulkan_bright_bring(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch,
                        const struct vulkan_chunk *chunk, uint64_t room, struct vulkan_recording *recording,
                        struct kiln_error *error)
{
    (void)room;
    const struct kiln_directions_parameters *p = parameters;
    struct vulkan_slot *slot = &b->slots[chunk->slot];
    struct receivers r = {.bright = p->bright, .points = chunk->all.total};
    size_t bytes = 0;
    int status;
    KILN_TRY(make_receivers(&r, b, batch, chunk, error));
    bytes = numbers_at(&r, b) + r.points * sizeof *r.of;
    KILN_TRY(vulkan_slot_room(b, slot, bytes, WHAT, error));
    write_chunk(&r, b, p->scale, slot);
    vulkan_record_copy(recording, &slot->guides_host, &slot->guides, bytes);
end:
    receivers_release(&r);
    return status;
}

size_t vulkan_bright_bytes(const struct kiln_bright *bright)
{
    return (2 * (size_t)bright->count * sizeof(double) + CLUSTER - 1) / CLUSTER + 2 * sizeof(uint32_t);
}
