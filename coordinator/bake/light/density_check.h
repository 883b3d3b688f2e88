/* Check of the texel density: a second solve at half the density, with few samples, and a comparison of each object's
 * mean with that of the bake. The change from halving the density predicts the change from doubling it: if the error
 * falls with the texel's side h as h^p, E(h / 2) - E(h) is (E(h) - E(2h)) / 2^p (Richardson, "The Deferred Approach to
 * the Limit", 1927). p is KILN_DENSITY_ORDER, which was measured for light through narrow gaps (tests/bench/NOTES.md).
 */
#ifndef KILN_COORDINATOR_BAKE_LIGHT_DENSITY_CHECK_H
#define KILN_COORDINATOR_BAKE_LIGHT_DENSITY_CHECK_H

#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/integrate/integrate.h"

#define KILN_DENSITY_ORDER 0.5
#define KILN_DENSITY_MOST 0.05 /* relative: objects whose mean double density would change by more are named */

struct kiln_density_object {
    double mean;   /* mean luminance of irradiance over valid texels of the front in the bake, W/m2 */
    double coarse; /* the same at half the texel density */
    double error;  /* standard error of `coarse` - `mean` by the texels' own samples, W/m2 */
    double moves;  /* relative change of `mean` that double density would make, about; 0: too dark to tell */
};

/* The result is the same on all ranks, and for any number of them. */
struct kiln_density_check {
    bool wanted, done;
    struct kiln_error because;           /* wanted but not done: why */
    double seconds;                      /* that it took this rank */
    uint64_t points;                     /* of the coarse solve */
    size_t count;                        /* objects that double density would move by more than KILN_DENSITY_MOST */
    struct kiln_density_object *objects; /* one for each object of the scene; NULL: not done */
};

/* Collective. Runs the check of a complete bake; `params` and `solution` are the bake's. If the check cannot be made,
 * for want of memory say, the call still succeeds and `because` has the reason. KILN_STOPPED when something asks to
 * stop; nothing is saved then. Release with kiln_density_check_release, in any case. */
int kiln_density_check_run(struct kiln_density_check *check, const struct kiln_prepared *prepared,
                           const struct kiln_job *job, const struct kiln_integrate_params *params,
                           const struct kiln_solution *solution, struct kiln_error *error);
void kiln_density_check_release(struct kiln_density_check *check);

#endif
