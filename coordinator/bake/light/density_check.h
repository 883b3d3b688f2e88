/* Whether the texels are fine enough: a second solve at half the texel density, with few samples, whose objects' means
 * are compared with those of the bake. What halving the density changes tells what doubling it would change: where an
 * error falls with the texel's side h as h^p, E(h / 2) - E(h) is (E(h) - E(2h)) / 2^p (Richardson, "The Deferred
 * Approach to the Limit", 1927). p is KILN_DENSITY_ORDER: light that comes through narrow gaps was measured to have it
 * (tests/bench/NOTES.md). */
#ifndef KILN_COORDINATOR_BAKE_LIGHT_DENSITY_CHECK_H
#define KILN_COORDINATOR_BAKE_LIGHT_DENSITY_CHECK_H

#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/integrate/integrate.h"

#define KILN_DENSITY_ORDER 0.5
#define KILN_DENSITY_MOST 0.05 /* relative: objects that double density would move by more are named */

struct kiln_density_object {
    double mean;   /* luminance of irradiance over valid texels of the front, W/m2: of the bake */
    double coarse; /* the same at half the texel density */
    double error;  /* standard error of `coarse` - `mean` by the texels' own samples, W/m2 */
    double moves;  /* by about so much of `mean`, up or down, double density would move it; 0: it is too dark to tell */
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

/* Collective. `params` and `solution` are those of the bake, which is complete. A check that cannot be made, for want
 * of memory say, is no failure: `because` says it. KILN_STOPPED when something asks to stop; nothing is saved then.
 * Release with kiln_density_check_release, in any case. */
int kiln_density_check_run(struct kiln_density_check *check, const struct kiln_prepared *prepared,
                           const struct kiln_job *job, const struct kiln_integrate_params *params,
                           const struct kiln_solution *solution, struct kiln_error *error);
void kiln_density_check_release(struct kiln_density_check *check);

#endif
