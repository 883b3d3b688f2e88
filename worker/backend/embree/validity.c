/* The validity pass (worker/pass/validity.h): which share of each point is buried in other geometry. */
#include <omp.h>

#include "shaders/shared/streams.h"
#include "worker/backend/embree/embree.h"
#include "worker/backend/embree/frame.h"
#include "worker/base/memory.h"
#include "worker/pass/validity.h"
#include "worker/sampling/sequence.h"

/* How many of `samples` places of point j are buried; where only `whether` none, some or all are is asked, not all need
 * be looked at. */
static uint32_t count_buried(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j, uint32_t samples,
                             uint32_t stream, bool whether)
{
    const uint32_t key = kiln_validity_key(stream), shift_s = kiln_hash1(key), shift_t = kiln_hash1(key + 1u);
    uint32_t buried = 0;
    f->key[j] = key;
    struct kiln_vec3 position[PACKET], normal[PACKET];
    for (uint32_t k = 0; k < samples && !(whether && buried > 0 && buried < k); k += PACKET) {
        const uint32_t count = samples - k < PACKET ? samples - k : PACKET;
        for (uint32_t i = 0; i < count; i++)
            (void)frame_position(f, b, j, kiln_unit_float(kiln_sobol(k + i, 0) ^ shift_s),
                                 kiln_unit_float(kiln_sobol(k + i, 1) ^ shift_t), &position[i], &normal[i]);
        buried += frame_count_buried(b, position, normal, count);
    }
    return buried;
}

static uint16_t visible_share(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j, uint64_t *rays)
{
    const uint32_t first = count_buried(f, b, j, KILN_VALIDITY_FIRST_LOOK, KILN_VALIDITY_FIRST_STREAM, true);
    *rays += KILN_VALIDITY_FIRST_LOOK;
    if (first == 0 || first == KILN_VALIDITY_FIRST_LOOK)
        return first == 0 ? 0xffff : 0;
    *rays += KILN_VALIDITY_SECOND_LOOK;
    return kiln_validity_share(count_buried(f, b, j, KILN_VALIDITY_SECOND_LOOK, KILN_VALIDITY_SECOND_STREAM, false));
}

int embree_validity(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                    uint64_t *rays, struct kiln_error *error)
{
    (void)parameters;
    const struct kiln_tile_run *tile_runs = b->surface->tile_runs + part->first;
    struct tile_run_frame *frames = NULL;
    const int status = kiln_allocate(&frames, b->threads, sizeof *frames, "the validity pass", error);
    if (status != KILN_OK)
        return status;
    uint64_t traced = 0;
#pragma omp parallel num_threads((int)b->threads) reduction(+ : traced)
    {
        const unsigned saved = embree_enter();
        struct tile_run_frame *f = &frames[omp_get_thread_num()];
#pragma omp for schedule(dynamic, 4)
        for (size_t i = 0; i < part->count; i++) {
            uint16_t *visible = (uint16_t *)results + (tile_runs[i].first.at - tile_runs[0].first.at);
            frame_build(f, b, part->first + i, UINT64_MAX, FRAME_EVERY);
            for (uint32_t j = 0; j < f->count; j++)
                visible[f->place[j]] = visible_share(f, b, j, &traced);
        }
        embree_leave(saved);
    }
    *rays += traced;
    kiln_free(&frames);
    return KILN_OK;
}
