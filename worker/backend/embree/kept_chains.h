/* Chains that are kept beside the rows of a tile run's points (worker/pass/row_chains.h): made of what traced rays have
 * found, or read in their place. */
#ifndef KILN_WORKER_BACKEND_EMBREE_KEPT_CHAINS_H
#define KILN_WORKER_BACKEND_EMBREE_KEPT_CHAINS_H

#include "worker/backend/embree/rays.h"
#include "worker/backend/embree/walk.h"
#include "worker/pass/point.h"
#include "worker/pass/row_chains.h"

/* A thread's. Zero: there are none. */
struct kept_chains {
    struct kiln_row_chains *file;     /* borrowed; NULL: none */
    struct chain_notes of[RAY_LANES]; /* of each point of the frame: its stream, while rays are traced */
    size_t begin;                     /* where the stream of the ray under way begins */
    uint32_t *streams;                /* of the tile run, as they are read or written */
    size_t room;
    const uint32_t *next[RAY_LANES]; /* of each point of the frame: where the stream of its next ray is */
    struct kiln_row_chain record[RAY_LANES];
};

void kept_chains_release(struct kept_chains *kept);

/* ---- of rays that are traced ---- */

/* Nothing has been found by the first `points` points. */
void kept_chains_begin(struct kept_chains *kept, uint32_t points);
/* The next ray of point j; `tint`: NULL: of no colour. Returns what notes its chain. */
struct chain_notes *kept_chains_ray(struct kept_chains *kept, uint32_t j, const float *tint);
/* A surface point sends so much of its radiosity to the ray under way. */
void kept_chains_answer(struct chain_notes *notes, uint32_t point, const float weight[3]);
/* The ray has found all. Returns its word in the row. */
uint32_t kept_chains_end(struct kept_chains *kept, uint32_t j, bool tinted);
/* Writes streams and records of the frame's points, which have these answers. False: it failed, and errno says how. */
bool kept_chains_write(struct kept_chains *kept, uint64_t key, uint64_t first, const struct tile_run_frame *frame,
                       const struct kiln_point_result *results);

/* ---- of rays that are looked up ---- */

/* Reads records and streams of points, by their place from `first` on. 0: it failed (errno), or a point has none; 1:
 * they are there, but not checked yet; -1: they lie beyond the file. */
int kept_chains_read(struct kept_chains *kept, uint64_t first, const uint32_t *place, uint32_t points);
/* Whether those of point j, of this global number, are as they were written. `row`: its words. */
bool kept_chains_are_whole(const struct kept_chains *kept, uint64_t key, uint32_t j, uint64_t point,
                           const uint32_t *row, uint32_t samples, uint64_t points);
/* Finds the light that the next ray of point j with such a word brings. */
static inline void kept_chains_light(struct kept_chains *kept, uint32_t j, bool tinted, const uint64_t *radiosity,
                                     float rgb[3])
{
    kept->next[j] = kiln_row_chain_light(kept->next[j], tinted, radiosity, rgb);
}

#endif
