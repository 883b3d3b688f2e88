#include "coordinator/integrate/land/land_state.h"

#include <math.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

size_t kiln_landing_arrays(struct kiln_landing *l, struct kiln_array_range blocks[KILN_LANDING_ARRAYS])
{
    const struct kiln_surface *own = &l->solution->own->surface;
    const uint64_t first = own->first.at, aims = l->aims->count;
    size_t count = 0;
    if (l->sums == NULL || l->pilots)
        return 0;
    l->record = (struct kiln_landing_saved){.step = l->solution->report.steps.count,
                                            .iteration = l->iteration,
                                            .done = l->done,
                                            .photons = l->photons,
                                            .aims = aims,
                                            .radius = l->radius};
    if (l->params->rank == 0) {
        blocks[count++] = (struct kiln_array_range){"landing", 0, 1, sizeof l->record, &l->record};
        blocks[count++] = (struct kiln_array_range){"landing_learnt", 0, aims, sizeof *l->learnt, l->learnt};
        blocks[count++] = (struct kiln_array_range){"landing_paths", 0, aims, sizeof *l->paths, l->paths};
    }
    blocks[count++] =
        (struct kiln_array_range){"landing_moments", 0, aims, sizeof *l->moments_before, l->moments_before};
    blocks[count++] = (struct kiln_array_range){"landing_sums", first, own->count, sizeof *l->sums, l->sums};
    if (kiln_landing_merges(l))
        blocks[count++] = (struct kiln_array_range){"landing_merged", first, own->count, sizeof *l->merged, l->merged};
    return count;
}

/* Adds the moments of a file to this rank's: which rank does that makes no difference to the sum. */
static int add_moments(struct kiln_landing *l, size_t part, struct kiln_error *error)
{
    uint64_t *moments = NULL, count = 0;
    const int status = kiln_checkpoint_read_file(l->params->checkpoint, part, "landing_moments", sizeof *moments,
                                                 &moments, &count, error);
    for (uint64_t i = 0; status == KILN_OK && i < count && i < l->aims->count; i++)
        l->moments[i] += moments[i];
    kiln_free(&moments);
    return status;
}

static bool is_sane(const struct kiln_landing *l, const struct kiln_landing_saved *s)
{
    bool sane = s->photons == l->photons && s->aims == l->aims->count && s->iteration <= kiln_landing_iterations(l) &&
                s->done <= s->photons && isfinite(s->radius);
    for (size_t i = 0; i < l->aims->count && sane; i++)
        sane = isfinite(l->learnt[i]) && l->learnt[i] >= 0.0 && isfinite(l->paths[i]) &&
               ((s->iteration == 0 && !kiln_landing_shares(l)) || l->paths[i] > 0.0);
    return sane;
}

static int read_landing(struct kiln_landing *l, const struct kiln_landing_saved *s, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = l->params->checkpoint;
    const struct kiln_surface *own = &l->solution->own->surface;
    const uint64_t first = own->first.at, aims = l->aims->count;
    int status;
    KILN_TRY(kiln_checkpoint_read(c, "landing_learnt", 0, aims, sizeof *l->learnt, l->learnt, error));
    KILN_TRY(kiln_checkpoint_read(c, "landing_paths", 0, aims, sizeof *l->paths, l->paths, error));
    KILN_TRY(kiln_checkpoint_read(c, "landing_sums", first, own->count, sizeof *l->sums, l->sums, error));
    if (kiln_landing_merges(l))
        KILN_TRY(kiln_checkpoint_read(c, "landing_merged", first, own->count, sizeof *l->merged, l->merged, error));
    for (size_t part = (size_t)l->params->rank; part < kiln_checkpoint_files(c); part += (size_t)l->params->ranks)
        KILN_TRY(add_moments(l, part, error));
end:
    return status == KILN_OK && !is_sane(l, s) ? kiln_array_insane("landing", error) : status;
}

int kiln_landing_restore(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = l->params->checkpoint;
    struct kiln_landing_saved s = {0};
    int status = KILN_OK;
    const bool any = !l->begun && c != NULL && kiln_checkpoint_generation(c) != 0 && kiln_checkpoint_has(c, "landing");
    l->begun = true;
    if (any)
        status = kiln_checkpoint_read(c, "landing", 0, 1, sizeof s, &s, error);
    const bool here = any && s.step == l->solution->report.steps.count;
    if (status == KILN_OK && here)
        status = read_landing(l, &s, error);
    status = kiln_agree(l->params->communicator, status, error);
    if (!here)
        kiln_solution_step(l->solution)->rays = 0; /* of paths that are traced again */
    if (status != KILN_OK || !here)
        return status;
    l->iteration = s.iteration;
    l->done = s.done;
    l->radius = s.radius;
    l->restored = true;
    if (kiln_landing_shares(l) || (l->iteration > 0 && l->iteration < kiln_landing_iterations(l)))
        kiln_landing_aim(l, l->photons); /* gather rays use the same weights of aims */
    return KILN_OK;
}
