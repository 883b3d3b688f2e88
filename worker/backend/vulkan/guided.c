/* The guided pass (worker/pass/guided.h): runs shaders/guided.comp, guided_learn.comp and guided_reduce.comp over the
 * batch's points. The host makes the guides of a chunk, equal to those of Embree, while the device computes earlier
 * chunks. */
#include <string.h>

#include "worker/backend/guide.h"
#include "worker/backend/vulkan/hemisphere.h"
#include "worker/base/memory.h"
#include "worker/pass/guided.h"

static const struct vulkan_shader gloss_shader = {
    .name = "guided with gloss", .compute = VULKAN_CODE(guided_gloss), .pipeline = VULKAN_CODE(guided_gloss_pipeline)};
static const struct vulkan_shader guided_shader = {
    .name = "guided", .compute = VULKAN_CODE(guided), .pipeline = VULKAN_CODE(guided_pipeline), .gloss = &gloss_shader};
static const struct vulkan_shader learn_shader = {.name = "guided: cells", .compute = VULKAN_CODE(guided_learn)};
static const struct vulkan_shader gloss_sums_shader = {.name = "guided with gloss: sums",
                                                       .compute = VULKAN_CODE(guided_reduce_gloss)};
static const struct vulkan_shader sums_shader = {
    .name = "guided: sums", .compute = VULKAN_CODE(guided_reduce), .gloss = &gloss_sums_shader};

_Static_assert(sizeof(struct kiln_gpu_guided_result) == sizeof(struct kiln_guided_result), "results");
_Static_assert(sizeof(struct kiln_gpu_guided_push) == sizeof(struct kiln_gpu_hemisphere_push) + 2 * sizeof(uint64_t),
               "the pass's own push constants come last");
_Static_assert(KILN_GUIDE_SIDE *KILN_GUIDE_SIDE <= 256, "a cell has eight bits");

enum { GUIDE_BYTES = KILN_GUIDE_SIZE * sizeof(float), CELLS_MOST = KILN_GUIDE_SIDE * KILN_GUIDE_SIDE };

/* Guides of a chunk during their creation. The slot's buffer holds the root struct, a word per point, and the guides.
 */
struct making {
    const struct vulkan_backend *b;
    const struct kiln_batch *batch;
    const struct vulkan_chunk *chunk;
    const struct kiln_guided_parameters *parameters;
    const struct kiln_tile_run *runs; /* of the chunk */
    uint32_t *number;                 /* number of each tile run's guide, from 1 on; 0: none */
    uint32_t count;                   /* of guides */
    char *to;                         /* the slot's buffer on the host */
};

static size_t guides_begin(const struct making *m)
{
    return sizeof(struct kiln_gpu_guided) + m->chunk->all.total * sizeof(uint32_t);
}

static float *guide_of(const struct making *m, uint32_t number)
{
    return (float *)(void *)(m->to + guides_begin(m) + (size_t)(number - 1) * GUIDE_BYTES);
}

/* Numbers the tile runs that may have a guide. */
static void number_guides(struct making *m)
{
    const bool follows = m->parameters->follows && m->b->surface->guide != NULL;
    for (size_t f = 0; f < m->chunk->tile_run_count; f++) {
        const bool may = follows && kiln_guide_side(m->runs[f].count) > 0 &&
                         !kiln_batch_leaves_out(m->batch, m->chunk->tile_run_first + f);
        m->number[f] = may ? ++m->count : 0;
    }
}

/* Makes the guides, and closes the gaps where a guide is no better than the cosine distribution. */
static void make_guides(struct making *m)
{
    const struct kiln_surface *s = m->b->surface;
#pragma omp parallel for num_threads((int)m->b->threads) schedule(dynamic, 16) if (m->count > 64)
    for (size_t f = 0; f < m->chunk->tile_run_count; f++) {
        const float *learnt =
            m->number[f] == 0 ? NULL : s->guide + KILN_GUIDE_FLOATS * kiln_own_of_global(s, m->runs[f].first).at;
        if (learnt != NULL && !kiln_guide_make(guide_of(m, m->number[f]), learnt, kiln_guide_side(m->runs[f].count)))
            m->number[f] = 0;
    }
    m->count = 0;
    for (size_t f = 0; f < m->chunk->tile_run_count; f++) {
        if (m->number[f] == 0)
            continue;
        if (m->number[f] != ++m->count)
            memcpy(guide_of(m, m->count), guide_of(m, m->number[f]), GUIDE_BYTES);
        m->number[f] = m->count;
    }
}

static void write_words(const struct making *m)
{
    uint32_t *words = (uint32_t *)(void *)(m->to + sizeof(struct kiln_gpu_guided));
    for (size_t f = 0; f < m->chunk->tile_run_count; f++) {
        const uint32_t points = m->runs[f].count, word = (points - 1) << KILN_GPU_GUIDE_LAST_SHIFT |
                                                         kiln_guide_side(points) / 8 << KILN_GPU_GUIDE_SIDE_SHIFT |
                                                         m->number[f] << KILN_GPU_GUIDE_NUMBER_SHIFT;
        for (uint32_t k = 0; k < points; k++)
            *words++ = word | k;
    }
}

/* Writes the root struct of a chunk. `room`: memory for the rays' words, then the squares, then the exponents. */
static void write_root(const struct making *m, uint64_t address, uint64_t room)
{
    struct kiln_gpu_guided root = {
        .near_probes = m->chunk->near_probes, .words = address + sizeof root, .guides = address + guides_begin(m)};
    const uint64_t total = m->chunk->all.total * sizeof(uint32_t);
    if (m->parameters->learns) {
        root.rays = room;
        root.squares = root.rays + m->batch->samples * total;
        root.exponents = root.squares + CELLS_MOST * total;
    }
    memcpy(m->to, &root, sizeof root);
}

static int bring(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch,
                 const struct vulkan_chunk *chunk, uint64_t room, struct vulkan_recording *recording,
                 struct kiln_error *error)
{
    struct vulkan_slot *slot = &b->slots[chunk->slot];
    struct making m = {.b = b,
                       .batch = batch,
                       .chunk = chunk,
                       .parameters = parameters,
                       .runs = &b->surface->tile_runs[chunk->tile_run_first]};
    int status = kiln_allocate(&m.number, chunk->tile_run_count, sizeof *m.number, "guides of tile runs", error);
    if (status != KILN_OK)
        return status;
    number_guides(&m);
    status = vulkan_slot_room(b, slot, guides_begin(&m) + (size_t)m.count * GUIDE_BYTES, "guides of tile runs", error);
    if (status == KILN_OK) {
        m.to = slot->guides_host.mapped;
        make_guides(&m);
        write_words(&m);
        write_root(&m, slot->guides.address, room);
        vulkan_record_copy(recording, &slot->guides_host, &slot->guides,
                           guides_begin(&m) + (size_t)m.count * GUIDE_BYTES);
    }
    kiln_free(&m.number);
    return status;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    const struct kiln_guided_parameters *p = parameters;
    const uint64_t own[2] = {0, 0}; /* filled in for each chunk */
    struct vulkan_hemisphere pass = vulkan_gather_pass(b, batch, own);
    pass.pass = &kiln_pass_guided;
    pass.shader = &guided_shader;
    pass.apart = pass.apart_sums = NULL; /* its kernel follows chains itself */
    pass.sums = &sums_shader;
    pass.pace = KILN_PASS_INDEX_guided;
    pass.failed_offset = offsetof(struct kiln_gpu_guided_result, point.error);
    pass.parameters = parameters;
    pass.bring = bring;
    pass.between = p->learns ? &learn_shader : NULL;
    pass.room_bytes = p->learns ? (batch->samples + CELLS_MOST + 1) * sizeof(float) : 0;
    return vulkan_hemisphere_run(b, &pass, batch, rays, error);
}

const struct vulkan_pass vulkan_pass_guided = {.run = run};
