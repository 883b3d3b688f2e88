#include "coordinator/integrate/land/land_state.h"

#include <math.h>
#include <string.h>

#define EVEN 0.25           /* part of the weights, learnt once for all, that all aims share equally */
#define MOMENT_STEP 65536.0 /* second moments are sums of whole numbers of 1 / this */
#define MOMENT_MOST 0x1p38  /* limit of one path's moment: 2^24 paths of the rarest kind fit into 64 bits */

void kiln_landing_forget(struct kiln_landing *l)
{
    const size_t count = l->aims->count;
    memset(l->moments, 0, count * sizeof *l->moments);
    memset(l->learnt, 0, count * sizeof *l->learnt);
    memset(l->paths, 0, count * sizeof *l->paths);
    kiln_aims_share(l->aims, l->photons, NULL);
    l->iteration = l->done = 0;
    l->pilots = l->restored = false;
    l->radius = l->params->settings->merge_radius;
}

void kiln_landing_note_rest(struct kiln_landing *l, struct kiln_landing_moments *moments)
{
    if (moments->sum == 0)
        return;
#pragma omp atomic
    l->moments[moments->aim] += moments->sum;
    moments->sum = 0;
}

void kiln_landing_note_moment(struct kiln_landing *l, struct kiln_landing_moments *moments, uint32_t aim,
                              double luminance)
{
    const struct kiln_aims *a = l->aims;
    const double paths = (double)(a->first[aim + 1] - a->first[aim]), flux = luminance * paths / a->aims[aim].flux;
    if (aim != moments->aim)
        kiln_landing_note_rest(l, moments);
    moments->aim = aim;
    moments->sum += a->aims[aim].flux > 0.0 ? (uint64_t)fmin(MOMENT_STEP * flux * flux, MOMENT_MOST) : 0;
}

void kiln_landing_aim(struct kiln_landing *l, uint64_t paths)
{
    kiln_aims_weigh(l->aims, l->learnt, l->paths, kiln_landing_shares(l) ? EVEN : 0.0, l->weights);
    kiln_aims_share(l->aims, paths, l->weights);
}

void kiln_landing_correct_aims(struct kiln_landing *l, uint64_t paths)
{
    struct kiln_aims *a = l->aims;
    (void)MPI_Allreduce(MPI_IN_PLACE, l->moments, (int)a->count, MPI_UINT64_T, MPI_SUM, l->params->communicator);
    for (size_t i = 0; i < a->count; i++) {
        l->learnt[i] += (double)l->moments[i] / MOMENT_STEP;
        l->paths[i] += (double)(a->first[i + 1] - a->first[i]);
        l->moments[i] = 0;
    }
    kiln_landing_aim(l, paths);
}
