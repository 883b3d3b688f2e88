/* The validity pass (worker/pass/validity.h): the share of each point that is buried in other geometry. */
#include <omp.h>

#include "shaders/shared/streams.h"
#include "worker/backend/embree/embree.h"
#include "worker/backend/embree/frame.h"
#include "worker/base/memory.h"
#include "worker/pass/validity.h"
#include "worker/sampling/sequence.h"

/* Positions to test, in the square of (s, t). */
struct look {
    float s[KILN_VALIDITY_SECOND_LOOK], t[KILN_VALIDITY_SECOND_LOOK];
    uint32_t key, samples;
    bool whether; /* only whether none, some or all are buried: may stop early */
};
_Static_assert(KILN_VALIDITY_FIRST_LOOK <= KILN_VALIDITY_SECOND_LOOK, "places of a look");

static void make_look(struct look *look, uint32_t samples, uint32_t stream, bool whether)
{
    look->key = kiln_validity_key(stream);
    look->samples = samples;
    look->whether = whether;
    for (uint32_t k = 0; k < samples; k++) {
        look->s[k] = kiln_unit_float(kiln_sobol(k, 0) ^ kiln_hash1(look->key));
        look->t[k] = kiln_unit_float(kiln_sobol(k, 1) ^ kiln_hash1(look->key + 1u));
    }
}

/* Counts the buried places of point j. */
static uint32_t count_buried(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j,
                             const struct look *look)
{
    uint32_t buried = 0;
    f->key[j] = look->key;
    struct kiln_vec3 position[PACKET], normal[PACKET];
    for (uint32_t k = 0; k < look->samples && !(look->whether && buried > 0 && buried < k); k += PACKET) {
        const uint32_t count = look->samples - k < PACKET ? look->samples - k : PACKET;
        for (uint32_t i = 0; i < count; i++)
            (void)frame_position(f, b, j, look->s[k + i], look->t[k + i], &position[i], &normal[i]);
        buried += frame_count_buried(b, position, normal, count);
    }
    return buried;
}

static uint16_t visible_share(struct tile_run_frame *f, const struct embree_backend *b, uint32_t j,
                              const struct look looks[2], uint64_t *rays)
{
    const uint32_t first = count_buried(f, b, j, &looks[0]);
    *rays += KILN_VALIDITY_FIRST_LOOK;
    if (first == 0 || first == KILN_VALIDITY_FIRST_LOOK)
        return first == 0 ? 0xffff : 0;
    *rays += KILN_VALIDITY_SECOND_LOOK;
    return kiln_validity_share(count_buried(f, b, j, &looks[1]));
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
    struct look looks[2];
    make_look(&looks[0], KILN_VALIDITY_FIRST_LOOK, KILN_VALIDITY_FIRST_STREAM, true);
    make_look(&looks[1], KILN_VALIDITY_SECOND_LOOK, KILN_VALIDITY_SECOND_STREAM, false);
    uint64_t traced = 0;
#pragma omp parallel num_threads((int)b->threads) reduction(+ : traced)
    {
        const unsigned saved = embree_enter();
        struct tile_run_frame *f = &frames[omp_get_thread_num()];
#pragma omp for schedule(dynamic, 4)
        for (size_t i = 0; i < part->count; i++) {
            uint16_t *visible = (uint16_t *)results + (tile_runs[i].first.at - tile_runs[0].first.at);
            frame_build(f, b, part->first + i, UINT64_MAX, FRAME_EVERY | FRAME_PLACES);
            for (uint32_t j = 0; j < f->count; j++)
                visible[f->place[j]] = visible_share(f, b, j, looks, &traced);
        }
        embree_leave(saved);
    }
    *rays += traced;
    kiln_free(&frames);
    return KILN_OK;
}
