/* The company of a bake: the set of its companions (companion.h), with their state. Each function calls the function of
 * the same name in all companions that the bake wants and that define it, in the order of the table; with a step, only
 * in those that take part in it. A function that can fail stops at the first failure. NULL is an empty company. */
#ifndef KILN_COORDINATOR_INTEGRATE_COMPANY_H
#define KILN_COORDINATOR_INTEGRATE_COMPANY_H

#include "coordinator/integrate/companion.h"

enum { KILN_COMPANY_MOST = 32 }; /* bits of `with` */

/* Zero: empty. */
struct kiln_company {
    const struct kiln_companion *const *table; /* of the params */
    struct kiln_companion_site site;
    struct {
        bool wanted;
        void *self;
    } of[KILN_COMPANY_MOST];
    bool whole_batches; /* some companion requires whole batches */
};

/* Not collective. Release with kiln_company_destroy, in any case. */
int kiln_company_create(struct kiln_company *company, const struct kiln_companion_site *site, struct kiln_error *error);
void kiln_company_destroy(struct kiln_company *company);

/* Collective. */
int kiln_company_settle(struct kiln_company *company, struct kiln_error *error);
int kiln_company_end(struct kiln_company *company, struct kiln_error *error);
int kiln_company_before_step(struct kiln_company *company, struct kiln_error *error);
int kiln_company_complete(struct kiln_company *company, struct kiln_error *error);
int kiln_company_after_step(struct kiln_company *company, double unit, struct kiln_error *error);
int kiln_company_before_move(struct kiln_company *company, const uint64_t *bounds, struct kiln_error *error);
int kiln_company_after_move(struct kiln_company *company, struct kiln_error *error);

/* Computes the results of a batch in a step that a companion answers (kiln_companion_answering). */
int kiln_company_answer(struct kiln_company *company, const struct kiln_step *step, const struct kiln_batch *batch,
                        struct kiln_error *error);
void kiln_company_take(const struct kiln_company *company, const struct kiln_taking *taking,
                       const struct kiln_rank_data *data, const struct kiln_tile_run *tile_run, const void *results);
/* Factor on the expected speed of a step, the product of the companions' `weight`, before any time is measured. */
double kiln_company_weight(const struct kiln_company *company, const struct kiln_step *step);

/* Whether a companion keeps separate lights besides the scene's; and the operations on all such lights. */
bool kiln_company_has_light(const struct kiln_company *company);
void kiln_company_exchange(struct kiln_company *company, bool restored);
void kiln_company_each_light(const struct kiln_company *company, void (*change)(const struct kiln_rank_data *own));
void kiln_company_extend(const struct kiln_company *company, struct kiln_own_point first, uint64_t count,
                         const float factor[3]);

void kiln_company_close(const struct kiln_company *company, struct kiln_energy_closing *closing);

/* Fills in the checkpoint blocks of all companions, at most KILN_COMPANY_ARRAYS, and returns their number. */
enum { KILN_COMPANY_ARRAYS = 2 * KILN_COMPANION_ARRAYS };
size_t kiln_company_arrays(struct kiln_company *company, struct kiln_array_range *blocks);
/* Bytes of a point in the arrays of a step. */
uint64_t kiln_company_saved_bytes(const struct kiln_company *company, const struct kiln_step *step);

#endif
