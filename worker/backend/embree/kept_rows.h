/* Rows (worker/pass/rows.h) of a tile run's points: recorded from the hits of its rays, or read instead of tracing. */
#ifndef KILN_WORKER_BACKEND_EMBREE_KEPT_ROWS_H
#define KILN_WORKER_BACKEND_EMBREE_KEPT_ROWS_H

#include "worker/backend/embree/kept_chains.h"
#include "worker/backend/embree/lookup.h"
#include "worker/pass/point.h"
#include "worker/pass/rows.h"

/* A thread's kept rows. Zero: rays are traced, and nothing is kept. */
struct kept_rows {
    struct kiln_rows *rows; /* borrowed; NULL: none */
    uint32_t samples;       /* samples of a point of the tile run */
    uint32_t *words;        /* of point j of the frame: its check and its samples, from j (1 + samples) on */
    struct kept_chains chains;
};

/* Creates rows of a part of a batch, if the backend has some. Without chains, rows are possible only if all rays of the
 * scene end at their first hit and have no tint. */
int kept_rows_create(struct kept_rows *kept, const struct embree_backend *b, const struct kiln_batch *part,
                     struct kiln_error *error);
void kept_rows_release(struct kept_rows *kept);

/* Replays a tile run from its rows alone, if its mesh is flat and its points are opaque: the points need not be
 * prepared for sampling (frame.h), as no sum depends on that. Gives the same bits as the gather pass, in results that
 * are zeros before. False: the tile run is not of this kind, or some of its points have no row. */
bool kept_rows_replay(struct kept_rows *kept, const struct embree_backend *b, const struct kiln_batch *part,
                      size_t tile_run, struct kiln_point_result *results);

/* Reads the rows of `points` points of the tile run; returns whether all have one, so that no tracing is needed.
 * `place`: places of the points in the tile run. Damaged rows count as missing, and the pass fails in the end
 * (rows->status). */
bool kept_rows_read(struct kept_rows *kept, const struct embree_backend *b, size_t tile_run, const uint32_t *place,
                    uint32_t points);
/* Looks up, in the rows that were read, the hits of the first `lanes` lanes of a step; as embree_find. */
void kept_rows_find(const struct kept_rows *kept, const struct embree_backend *b, const struct tile_run_rays *rays,
                    uint32_t step, uint32_t lanes, struct rays_found *found);
/* Records the hits of the traced rays of a step. */
void kept_rows_note(struct kept_rows *kept, const struct tile_run_rays *rays, uint32_t step,
                    const struct rays_found *found);
/* Writes the rows of the tile run, after all its steps were recorded, and its points' answers. */
void kept_rows_write(struct kept_rows *kept, const struct embree_backend *b, const struct tile_run_rays *rays,
                     size_t tile_run, const struct kiln_point_result *results);

/* Whether chains and tinted rays are recorded as they are traced, or are read from a file. */
static inline bool kept_rows_note_chains(const struct kept_rows *kept)
{
    return kept->chains.file != NULL && !kept->rows->replays;
}
static inline bool kept_rows_find_chains(const struct kept_rows *kept)
{
    return kept->chains.file != NULL && kept->rows->replays;
}
/* Returns the word of lane l's ray in a step; the code that follows the ray's chain changes it. */
static inline uint32_t *kept_rows_word(const struct kept_rows *kept, const struct tile_run_rays *rays, uint32_t step,
                                       uint32_t l)
{
    return &kept->words[rays->point[l] * (1 + kept->samples) + 1 + step * rays->copies + rays->copy[l]];
}

/* kept_rows_weighs: whether the weights of rays of smooth points are to be recorded, once their directions are made.
 * kept_rows_weigh: records them for lane l of a step. */
static inline bool kept_rows_weighs(const struct kept_rows *kept)
{
    return kept->rows != NULL && kept->rows->resident != NULL;
}
void kept_rows_weigh(const struct kept_rows *kept, const struct tile_run_rays *rays, size_t tile_run, uint32_t step,
                     uint32_t l, float incident, float irradiance);

#endif
