/* Chains kept in addition to the rows of a tile run's points (worker/pass/row_chains.h): recorded from traced rays, or
 * read instead of tracing. */
#ifndef KILN_WORKER_BACKEND_EMBREE_KEPT_CHAINS_H
#define KILN_WORKER_BACKEND_EMBREE_KEPT_CHAINS_H

#include "worker/backend/embree/rays.h"
#include "worker/backend/embree/walk.h"
#include "worker/pass/point.h"
#include "worker/pass/row_chains.h"

/* A thread's kept chains. Zero: none. */
struct kept_chains {
    struct kiln_row_chains *file;     /* borrowed; NULL: none */
    struct chain_notes of[RAY_LANES]; /* stream of each point of the frame while its rays are traced */
    size_t begin;                     /* begin of the current ray's stream */
    uint32_t *streams;                /* streams of the tile run, in the file's format */
    size_t room;
    const uint32_t *next[RAY_LANES]; /* for each point of the frame: stream of its next ray */
    struct kiln_row_chain record[RAY_LANES];
};

void kept_chains_release(struct kept_chains *kept);

/* ---- rays that are traced and recorded ---- */

/* Begins recording for `points` points, with empty streams. */
void kept_chains_begin(struct kept_chains *kept, uint32_t points);
/* Begins the next ray of point j; `tint`: NULL: none. Returns the notes that record its chain. */
struct chain_notes *kept_chains_ray(struct kept_chains *kept, uint32_t j, const float *tint);
/* Records that a surface point sends `weight` times its radiosity to the current ray. */
void kept_chains_answer(struct chain_notes *notes, uint32_t point, const float weight[3]);
/* Ends the current ray. Returns its word in the row. */
uint32_t kept_chains_end(struct kept_chains *kept, uint32_t j, bool tinted);
/* Writes streams and records of the frame's points and their answers. False: failed, with errno set. */
bool kept_chains_write(struct kept_chains *kept, uint64_t key, uint64_t first, const struct tile_run_frame *frame,
                       const struct kiln_point_result *results);

/* ---- rays that are read instead of traced ---- */

/* Reads records and streams of points, by their place from `first` on. 0: failed (errno), or a point has none; 1: read,
 * but not checked yet; -1: they lie beyond the end of the file. */
int kept_chains_read(struct kept_chains *kept, uint64_t first, const uint32_t *place, uint32_t points);
/* Whether record and stream of point j, with this global number, are as they were written. `row`: the point's words. */
bool kept_chains_are_whole(const struct kept_chains *kept, uint64_t key, uint32_t j, uint64_t point,
                           const uint32_t *row, uint32_t samples, uint64_t points);
/* Evaluates the light of point j's next ray, with such a word. */
static inline void kept_chains_light(struct kept_chains *kept, uint32_t j, bool tinted, const uint64_t *radiosity,
                                     float rgb[3])
{
    kept->next[j] = kiln_row_chain_light(kept->next[j], tinted, radiosity, rgb);
}

#endif
