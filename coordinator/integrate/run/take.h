/* Processes the answers of a backend: passes tile runs to the integrator, by several threads, and adds up their
 * tallies. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_TAKE_H
#define KILN_COORDINATOR_INTEGRATE_RUN_TAKE_H

#include "coordinator/integrate/integrator.h"

struct kiln_taker {
    struct kiln_taking taking; /* of the step under way */
    struct kiln_ledger *ledger;
    const struct kiln_company *company; /* also receives the answers; NULL: none */
    uint32_t threads;
    /* some radiosity is absent: a tile run with an answer that lacks some is marked in its owner's data (lacking) and
     * not taken */
    bool may_lack;
    struct kiln_tile_run_tally *tile_runs; /* of the part being taken */
    size_t tile_run_room;
};

/* Processes the tile runs [first, first + count) of `data`. `results`: answers of their points, an array of the result
 * struct of the step's pass. `samples`: one of each tile run; those with 0 are left out; NULL: none. KILN_SYSTEM. */
int kiln_taker_take(struct kiln_taker *taker, const struct kiln_rank_data *data, size_t first, size_t count,
                    const uint32_t *samples, const void *results, struct kiln_error *error);

/* Fills in the answers of the own tile runs [first, first + count) in a step. Called by several threads at once. */
typedef void (*kiln_give_results)(void *context, const struct kiln_step *step, size_t first, size_t count,
                                  struct kiln_point_result *results);
/* Likewise for answers that `give` computes tile run by tile run: they never are in memory all together. */
int kiln_taker_take_given(struct kiln_taker *taker, const struct kiln_rank_data *data, size_t first, size_t count,
                          kiln_give_results give, void *context, struct kiln_error *error);
void kiln_taker_release(struct kiln_taker *taker);

#endif
