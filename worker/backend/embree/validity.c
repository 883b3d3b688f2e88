/* Which share of each point is buried in other geometry.
 *
 * 16 places a point first, each with a ray along its normal (and three more where that meets a back face:
 * frame_buried). A point with all of them buried is invalid; where some are, 64 more give the share, and a point of
 * which less than 1/32 is left is invalid too. */
#include <omp.h>

#include "shaders/shared/streams.h"
#include "worker/backend/embree/embree.h"
#include "worker/backend/embree/frame.h"
#include "worker/base/memory.h"
#include "worker/sampling/sequence.h"

/* How many of `samples` places of point j are buried. */
static uint32_t count_buried(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j, uint32_t samples,
                             uint32_t stream)
{
    const uint32_t key = kiln_hash2(f->key[j], stream), shift_s = kiln_hash1(key), shift_t = kiln_hash1(key + 1u);
    uint32_t buried = 0;
    for (uint32_t k = 0; k < samples; k++) {
        struct kiln_vec3 p, n;
        frame_position(f, b, j, kiln_unit_float(kiln_sobol(k, 0) ^ shift_s),
                       kiln_unit_float(kiln_sobol(k, 1) ^ shift_t), &p, &n);
        buried += frame_buried(b, p, n);
    }
    return buried;
}

static uint16_t visible_share(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j)
{
    const uint32_t first = count_buried(f, b, j, KILN_VALIDITY_FIRST_LOOK, KILN_VALIDITY_FIRST_STREAM);
    if (first == 0 || first == KILN_VALIDITY_FIRST_LOOK)
        return first == 0 ? 0xffff : 0;
    const uint32_t left =
        KILN_VALIDITY_SECOND_LOOK - count_buried(f, b, j, KILN_VALIDITY_SECOND_LOOK, KILN_VALIDITY_SECOND_STREAM);
    if (left == KILN_VALIDITY_SECOND_LOOK) /* the first look saw a corner that the second missed */
        return 0xffff - 0xffff / KILN_VALIDITY_SECOND_LOOK;
    return left < KILN_VALIDITY_SECOND_LOOK / 32 ? 0 : (uint16_t)(left * 0xffffu / KILN_VALIDITY_SECOND_LOOK);
}

int embree_validity(struct kiln_backend *backend, size_t tile_run_first, size_t tile_run_count, uint16_t *visible,
                    struct kiln_error *error)
{
    const struct embree_backend *b = (const struct embree_backend *)backend;
    struct tile_run_frame *frames = NULL;
    const int status = kiln_allocate(&frames, b->threads, sizeof *frames, "the validity pass", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel num_threads((int)b->threads)
    {
        const unsigned saved = embree_enter();
        struct tile_run_frame *f = &frames[omp_get_thread_num()];
#pragma omp for schedule(dynamic, 4)
        for (size_t i = 0; i < tile_run_count; i++) {
            const uint64_t own = b->surface->tile_runs[tile_run_first + i].first - b->surface->first;
            frame_build(f, b, tile_run_first + i, FRAME_EVERY);
            for (uint32_t j = 0; j < f->count; j++)
                visible[own + f->place[j]] = visible_share(f, b, j);
        }
        embree_leave(saved);
    }
    kiln_free(&frames);
    return KILN_OK;
}
