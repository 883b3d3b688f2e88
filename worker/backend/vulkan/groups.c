#include "worker/backend/vulkan/groups.h"

#include <assert.h>
#include <string.h>

#include "worker/base/memory.h"

uint32_t vulkan_groups_floats(const struct vulkan_backend *b)
{
    return vulkan_groups_count(b) * (b->constants[VULKAN_HAS_SMOOTH] != 0 ? KILN_GROUP_FLOATS : 3u);
}

void vulkan_groups_release(struct vulkan_backend *b)
{
    gpu_buffer_destroy(b->gpu, &b->light_groups);
    gpu_buffer_destroy(b->gpu, &b->group_lights);
    for (int i = 0; i < GPU_SLOTS; i++) {
        gpu_buffer_destroy(b->gpu, &b->slots[i].groups);
        gpu_buffer_destroy(b->gpu, &b->slots[i].groups_host);
    }
}

/* ---- what kernels need ---- */

static struct kiln_gpu_light_block block_of(const struct kiln_light_block *from)
{
    struct kiln_gpu_light_block block = {.columns = from->columns, .rows = from->rows};
    for (int k = 0; k < 2; k++) {
        block.at[k] = (float)from->at[k];
        block.along1[k] = (float)from->along[0][k];
        block.along2[k] = (float)from->along[1][k];
    }
    return block;
}

int vulkan_groups_of_lights(struct vulkan_backend *b, struct kiln_error *error)
{
    const struct kiln_lights *l = b->params.lights;
    const struct kiln_light_groups *g = b->base.given.groups->lights;
    const size_t tree = (l->area_count + l->point_count) * sizeof *g->of_tree,
                 directional = l->directional_count * sizeof *g->of_directional,
                 blocks = l->area_count * sizeof(struct kiln_gpu_light_block),
                 bytes = sizeof(struct kiln_gpu_light_groups) + tree + directional + blocks;
    unsigned char *all = NULL;
    int status = vulkan_grow_buffer(b, &b->light_groups, bytes, GPU_DEVICE, "groups of lights", error);
    if (status == KILN_OK)
        status = kiln_allocate(&all, bytes, 1, "groups of lights", error);
    if (status != KILN_OK)
        return status;
    const uint64_t of_tree = b->light_groups.address + sizeof(struct kiln_gpu_light_groups);
    const struct kiln_gpu_light_groups root = {.of_tree = of_tree,
                                               .of_directional = of_tree + tree,
                                               .blocks = of_tree + tree + directional,
                                               .count = g->count,
                                               .of_environment = g->of_environment,
                                               .sky_divisions = g->sky_divisions};
    unsigned char *to = all;
    memcpy(to, &root, sizeof root);
    memcpy(to += sizeof root, g->of_tree, tree);
    memcpy(to += tree, g->of_directional, directional);
    to += directional;
    for (size_t i = 0; i < l->area_count; i++) {
        const struct kiln_gpu_light_block block = block_of(&g->block_of[i]);
        memcpy(to + i * sizeof block, &block, sizeof block);
    }
    status = gpu_upload(b->gpu, &b->light_groups, 0, all, bytes, error);
    kiln_free(&all);
    b->layout.lights.groups = b->light_groups.address;
    return status == KILN_OK ? vulkan_upload_root(b, error) : status;
}

int vulkan_groups_radiosity(struct vulkan_backend *b, struct kiln_error *error)
{
    struct kiln_groups *g = b->base.given.groups;
    const size_t bytes = (size_t)b->surface->point_count * g->lights->count * sizeof *g->radiosity;
    if (!g->changed && b->group_lights.size >= bytes)
        return KILN_OK;
    int status = vulkan_grow_buffer(b, &b->group_lights, bytes, GPU_DEVICE, "the radiosity of groups", error);
    if (status == KILN_OK)
        status = gpu_upload(b->gpu, &b->group_lights, 0, g->radiosity, bytes, error);
    g->changed = status != KILN_OK;
    return status;
}

/* ---- answers ---- */

void vulkan_groups_begin(struct vulkan_backend *b)
{
    for (int i = 0; i < GPU_SLOTS; i++)
        b->slots[i].group_runs = 0;
}

int vulkan_groups_room(struct vulkan_backend *b, const struct vulkan_chunk *chunk, struct kiln_error *error)
{
    struct vulkan_slot *slot = &b->slots[chunk->slot];
    const size_t wanted = chunk->all.total * vulkan_groups_floats(b) * sizeof(float);
    const bool fits = !gpu_guarded(b->gpu) && slot->groups.size >= wanted;
    const size_t bytes = fits ? slot->groups.size : gpu_guarded(b->gpu) ? wanted : wanted + wanted / 2;
    slot->group_first = chunk->tile_run_first;
    slot->group_runs = chunk->tile_run_count;
    int status = vulkan_grow_buffer(b, &slot->groups, bytes, GPU_DEVICE, "the light of groups", error);
    if (status == KILN_OK)
        status = vulkan_grow_buffer(b, &slot->groups_host, bytes, GPU_HOST, "the light of groups", error);
    return status;
}

void vulkan_groups_bring(struct vulkan_backend *b, const struct vulkan_chunk *chunk, struct vulkan_recording *recording)
{
    const struct vulkan_slot *slot = &b->slots[chunk->slot];
    const size_t bytes = chunk->all.total * vulkan_groups_floats(b) * sizeof(float);
    b->returned += bytes;
    vulkan_record_copy(recording, &slot->groups, &slot->groups_host, bytes);
}

/* The slot of the chunk that contains the tile run. */
static const struct vulkan_slot *slot_of(const struct vulkan_backend *b, size_t tile_run)
{
    const struct vulkan_slot *slot = b->slots;
    while (tile_run < slot->group_first || tile_run - slot->group_first >= slot->group_runs) {
        slot++;
        assert(slot < b->slots + GPU_SLOTS);
    }
    return slot;
}

/* Copies the answers of a tile run; zeros for points that are not wanted. */
static void copy_run(const struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run, const float *from,
                     float *to)
{
    const struct kiln_tile_run *run = &b->surface->tile_runs[tile_run];
    const uint64_t asked = kiln_batch_points(batch, tile_run), own = kiln_own_of_global(b->surface, run->first).at;
    const uint32_t count = vulkan_groups_count(b), floats = vulkan_groups_floats(b) / count;
    for (uint32_t k = 0; k < run->count; k++) {
        const bool there = (asked >> k & 1u) != 0 && kiln_point_valid(b->surface, (struct kiln_own_point){own + k});
        if (!there)
            memset(to, 0, count * KILN_GROUP_FLOATS * sizeof *to);
        for (uint32_t i = 0; i < count; i++, from += floats, to += KILN_GROUP_FLOATS) {
            if (!there)
                continue;
            memcpy(to, from, 3 * sizeof *to);
            memcpy(to + 3, from + floats - 3, 3 * sizeof *to);
        }
    }
}

int vulkan_groups_take(struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run_first,
                       size_t tile_run_count, struct kiln_error *error)
{
    struct kiln_groups *g = b->base.given.groups;
    const struct kiln_tile_run *runs = b->surface->tile_runs + tile_run_first;
    const struct vulkan_slot *slot = slot_of(b, tile_run_first);
    const uint64_t points = kiln_tile_runs_points(runs, runs + tile_run_count - 1),
                   before = runs[0].first.at - b->surface->tile_runs[slot->group_first].first.at;
    const size_t floats = vulkan_groups_floats(b), wanted = (size_t)g->lights->count * KILN_GROUP_FLOATS;
    const float *from = (const float *)slot->groups_host.mapped + before * floats;
    const int status =
        kiln_grow(&g->answers, &g->room, (size_t)points * wanted, sizeof *g->answers, "the light of groups", error);
    if (status != KILN_OK)
        return status;
    g->first = runs[0].first.at;
#pragma omp parallel for num_threads((int)b->threads) if (points * wanted > 1 << 16)
    for (size_t f = 0; f < tile_run_count; f++) {
        const size_t at = runs[f].first.at - runs[0].first.at;
        copy_run(b, batch, tile_run_first + f, from + at * floats, g->answers + at * wanted);
    }
    return KILN_OK;
}
