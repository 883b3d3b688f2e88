/* The rows (worker/pass/rows.h) of a tile run's points: made of what its rays have met, or read in their place. */
#ifndef KILN_WORKER_BACKEND_EMBREE_KEPT_ROWS_H
#define KILN_WORKER_BACKEND_EMBREE_KEPT_ROWS_H

#include "worker/backend/embree/kept_chains.h"
#include "worker/backend/embree/lookup.h"
#include "worker/pass/point.h"
#include "worker/pass/rows.h"

/* A thread's. Zero: rays are traced, and nothing is kept. */
struct kept_rows {
    struct kiln_rows *rows; /* borrowed; NULL: none */
    uint32_t samples;       /* of a point of the tile run */
    uint32_t *words;        /* of point j of the frame: its check and its samples, from j (1 + samples) on */
    struct kept_chains chains;
};

/* Rows of a part of a batch, where the backend has some; without chains, only where all rays of the scene end where
 * they first meet something, and have no tint. */
int kept_rows_create(struct kept_rows *kept, const struct embree_backend *b, const struct kiln_batch *part,
                     struct kiln_error *error);
void kept_rows_release(struct kept_rows *kept);

/* Replays a tile run by its rows alone, where its mesh is flat and its points are opaque: without its points made ready
 * for sampling (frame.h), on which no sum hangs there. Gives the results of the gather pass, which are zeros before,
 * and the same bits. False: it is another tile run, or not all of its points have a row. */
bool kept_rows_replay(struct kept_rows *kept, const struct embree_backend *b, const struct kiln_batch *part,
                      size_t tile_run, struct kiln_point_result *results);

/* Whether the rays of `points` points of the tile run are found in the file, and so need not be traced: all have a row.
 * `place`: of each among the tile run's points. What is damaged is none, and ends the pass in the end (rows->status).
 */
bool kept_rows_read(struct kept_rows *kept, const struct embree_backend *b, size_t tile_run, const uint32_t *place,
                    uint32_t points);
/* Finds what the rays of the first `lanes` lanes of a step have met, by the rows that were read; as embree_find. */
void kept_rows_find(const struct kept_rows *kept, const struct embree_backend *b, const struct tile_run_rays *rays,
                    uint32_t step, uint32_t lanes, struct rays_found *found);
/* Makes a note of what the traced rays of a step have met. */
void kept_rows_note(struct kept_rows *kept, const struct tile_run_rays *rays, uint32_t step,
                    const struct rays_found *found);
/* Writes the rows of the tile run, all of whose steps were noted, and whose points have these answers. */
void kept_rows_write(struct kept_rows *kept, const struct embree_backend *b, const struct tile_run_rays *rays,
                     size_t tile_run, const struct kiln_point_result *results);

/* Whether rays that go on or are tinted are kept as they are traced, or have been found in a file. */
static inline bool kept_rows_note_chains(const struct kept_rows *kept)
{
    return kept->chains.file != NULL && !kept->rows->replays;
}
static inline bool kept_rows_find_chains(const struct kept_rows *kept)
{
    return kept->chains.file != NULL && kept->rows->replays;
}
/* The word of the ray of lane l in a step; to be changed by who follows its chain. */
static inline uint32_t *kept_rows_word(const struct kept_rows *kept, const struct tile_run_rays *rays, uint32_t step,
                                       uint32_t l)
{
    return &kept->words[rays->point[l] * (1 + kept->samples) + 1 + step * rays->copies + rays->copy[l]];
}

/* Whether what rays of smooth points weigh is to be noted, of rays whose directions are made; and notes it, of lane l
 * of a step. */
static inline bool kept_rows_weighs(const struct kept_rows *kept)
{
    return kept->rows != NULL && kept->rows->resident != NULL;
}
void kept_rows_weigh(const struct kept_rows *kept, const struct tile_run_rays *rays, size_t tile_run, uint32_t step,
                     uint32_t l, float incident, float irradiance);

#endif
