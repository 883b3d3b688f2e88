#include "worker/backend/vulkan/answers.h"

#include <string.h>

#include "worker/backend/hand_over.h"
#include "worker/base/memory.h"

enum { POINTS_AT_ONCE = 1 << 16 };

/* ---- what there is ---- */

static struct vulkan_answer count_words(struct vulkan_answer a)
{
    a.words = KILN_GPU_SHORT_RAYS + (a.rays ? (a.whole ? 1u : 2u) : 0u) + (a.mixed ? 3u : 0u) + (a.tints ? 3u : 0u) +
              (a.gloss ? 3u : 0u) + (a.alpha ? 1u : 0u);
    return a;
}

/* Returns the members that are equal for all answers. */
static struct vulkan_answer answer_of_scene(const struct vulkan_backend *b)
{
    return (struct vulkan_answer){.mixed = b->constants[VULKAN_HAS_SMOOTH] != 0 || b->materials.gloss,
                                  .alpha = b->params.geometry->passage != KILN_PASSAGE_NONE};
}

struct vulkan_answer vulkan_answer_of_gather(const struct vulkan_backend *b, uint32_t samples)
{
    struct vulkan_answer a = answer_of_scene(b);
    a.rays = true;
    a.whole = !a.mixed && samples <= KILN_GPU_SHORT_MOST;
    a.tints = b->params.geometry->passage >= KILN_PASSAGE_TINT;
    a.gloss = b->materials.gloss;
    return count_words(a);
}

struct vulkan_answer vulkan_answer_of_direct(const struct vulkan_backend *b) { return count_words(answer_of_scene(b)); }

/* ---- results of them ---- */

static const float *take_colors(const float *from, float colors[3])
{
    memcpy(colors, from, 3 * sizeof *colors);
    return from + 3;
}

static const float *take_rays(const struct vulkan_answer *a, const float *from, struct kiln_point_result *r)
{
    if (a->whole) {
        uint32_t rays;
        memcpy(&rays, from++, sizeof rays);
        r->escaped = (float)(rays & 0xffffu);
        r->blocked = (float)(rays >> 16);
    } else {
        r->escaped = *from++;
        r->blocked = *from++;
    }
    return from;
}

/* Restores the result of a valid point from its words. */
static void lengthen_one(const struct vulkan_answer *a, const float *from, uint32_t samples,
                         struct kiln_point_result *r)
{
    *r = (struct kiln_point_result){.present = 1.0f, .count = samples};
    from = take_colors(from, r->incident);
    r->error = *from++;
    if (a->rays)
        from = take_rays(a, from, r);
    memcpy(r->irradiance, r->incident, sizeof r->irradiance);
    if (a->mixed)
        from = take_colors(from, r->irradiance);
    if (a->tints)
        from = take_colors(from, r->glass);
    if (a->gloss)
        from = take_colors(from, r->gloss);
    if (a->alpha)
        r->present = *from;
}

/* Restores the results of a tile run. `samples`: of each point; 0: it is left out. */
static void lengthen(const struct vulkan_backend *b, const struct vulkan_answer *a, uint32_t samples, uint64_t points,
                     const struct kiln_tile_run *run, const void *from, struct kiln_point_result *results)
{
    const uint64_t own = kiln_own_of_global(b->surface, run->first).at;
    for (uint32_t k = 0; k < run->count; k++)
        if (samples > 0 && (points >> k & 1u) != 0 && kiln_point_valid(b->surface, (struct kiln_own_point){own + k}))
            lengthen_one(a, (const float *)from + k * a->words, samples, &results[k]);
        else
            results[k] = (struct kiln_point_result){.count = 0};
}

void vulkan_lengthen_gather(const struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run,
                            const void *from, void *to)
{
    const struct vulkan_answer a = vulkan_answer_of_gather(b, batch->samples);
    lengthen(b, &a, batch->samples, kiln_batch_points(batch, tile_run), &b->surface->tile_runs[tile_run], from, to);
}

void vulkan_lengthen_direct(const struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run,
                            const void *from, void *to)
{
    const struct vulkan_answer a = vulkan_answer_of_direct(b);
    const uint32_t samples =
        batch->samples_each != NULL ? batch->samples_each[tile_run - batch->first] : batch->samples;
    lengthen(b, &a, samples, kiln_batch_points(batch, tile_run), &b->surface->tile_runs[tile_run], from, to);
}

/* ---- handing them on ---- */

/* Counts the first tile runs that fit together into one step, at least one. */
static size_t tile_runs_at_once(const struct kiln_tile_run *tile_runs, size_t count, uint64_t *points)
{
    size_t some = 0;
    for (*points = 0; some < count && *points < POINTS_AT_ONCE; some++)
        *points += tile_runs[some].count;
    return some;
}

int vulkan_take_short(struct vulkan_backend *b, vulkan_lengthen lengthen_run, size_t bytes,
                      const struct kiln_batch *batch, size_t tile_run_first, size_t tile_run_count, const void *results,
                      struct kiln_error *error)
{
    const struct kiln_tile_run *tile_runs = b->surface->tile_runs + tile_run_first;
    const char *from = results;
    int status = batch->take == NULL ? KILN_OK
                                     : kiln_grow(&b->results, &b->result_room,
                                                 (POINTS_AT_ONCE + KILN_TILE_TEXELS) * sizeof(struct kiln_point_result),
                                                 1, "the results of points", error);
    for (size_t done = 0, some; done < tile_run_count && status == KILN_OK && batch->take != NULL; done += some) {
        uint64_t points;
        const struct kiln_tile_run *first = tile_runs + done;
        struct kiln_point_result *to = (struct kiln_point_result *)(void *)b->results;
        some = tile_runs_at_once(first, tile_run_count - done, &points);
#pragma omp parallel for num_threads((int)b->threads) if (points > 1 << 14)
        for (size_t f = 0; f < some; f++) {
            const uint64_t at = first[f].first.at - first[0].first.at;
            if (kiln_batch_leaves_out(batch, tile_run_first + done + f))
                continue;
            lengthen_run(b, batch, tile_run_first + done + f, from + at * bytes, to + at);
        }
        status = kiln_batch_hand_over(batch, b->surface, sizeof *to, tile_run_first + done, some, to, error);
        from += points * bytes;
    }
    return status;
}
