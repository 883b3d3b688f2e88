#include "coordinator/integrate/parts/round_senders.h"

#include <math.h>

#include "coordinator/integrate/packing.h"
#include "coordinator/integrate/parts/part_errors.h"
#include "coordinator/integrate/parts/rounds.h"
#include "coordinator/integrate/parts/tile_pool.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

enum { BINS = 512, OCTAVE = 4 }; /* of gains, and their number in an octave */
#define WORK 1.0                 /* work for others over that of tile runs for themselves */

/* Work by gain, in points times halves of the samples of the first round. */
struct work {
    uint64_t own, by_gain[BINS];
};

/* Variance of the power that a tile run sends, of a sample and a point, W2. */
static double variance_of(const struct kiln_rank_data *data, const struct kiln_part_survey *survey, size_t i)
{
    const struct kiln_tile_run *run = &data->surface.tile_runs[i];
    struct kiln_own_point own = kiln_own_of_global(&data->surface, run->first);
    float errors[KILN_PART_ERRORS];
    double variance = 0.0;
    kiln_part_errors(data, run, survey, errors);
    for (uint32_t k = 0; k < run->count; k++, own.at++) {
        float albedo[3];
        if (!kiln_point_valid(&data->surface, own))
            continue;
        kiln_point_albedo(&data->surface, own, albedo);
        const double power = (double)errors[k] * (double)data->surface.area[own.at] * kiln_luminance_of_floats(albedo);
        variance += power * power;
    }
    return variance * (double)data->samples_taken[i] / run->count;
}

static size_t bin_of(double gain, double most)
{
    const double at = gain > 0.0 ? BINS + OCTAVE * log2(gain / most) : 0.0;
    return at < 0.0 ? 0 : at >= BINS ? BINS - 1 : (size_t)at;
}

/* Collective. The least bin whose tile runs get all samples of the round; BINS: none do. Bin 0 never does: it has the
 * tile runs without noise. */
static size_t least_bin(const struct kiln_integrate_params *p, const struct kiln_rank_data *data, const double *gains,
                        double most, uint64_t more)
{
    struct work work = {.own = 0};
    for (size_t i = 0; i < data->surface.tile_run_count; i++) {
        const uint64_t units = kiln_round_units(data->samples[i], more), count = data->surface.tile_runs[i].count;
        work.own += units * count;
        work.by_gain[bin_of(gains[i], most)] += (more - units) * count;
    }
    (void)MPI_Allreduce(MPI_IN_PLACE, &work, BINS + 1, MPI_UINT64_T, MPI_SUM, p->communicator);
    const double room = WORK * (double)work.own;
    size_t least = BINS;
    for (uint64_t sum = 0; least > 1 && (double)(sum + work.by_gain[least - 1]) <= room;)
        sum += work.by_gain[--least];
    return least;
}

/* Collective. Gain of a sample at each point of a tile run for those that gather from it, W2 a sample and point;
 * *most: of all. */
static int find_gains(const struct kiln_integrate_params *p, const struct kiln_rank_data *data,
                      const struct kiln_part_survey *survey, double *gains, double *most, struct kiln_error *error)
{
    const size_t count = data->surface.tile_run_count;
    uint32_t *points = NULL;
    double largest = 0.0;
    int status = kiln_allocate(&points, count, sizeof *points, "the noise of the tiles", error);
    KILN_TRY(kiln_agree(p->communicator, status, error));
#pragma omp parallel for schedule(static) reduction(max : largest)
    for (size_t i = 0; i < count; i++) {
        gains[i] = variance_of(data, survey, i);
        points[i] = data->surface.tile_runs[i].count;
        largest = fmax(largest, gains[i]);
    }
    (void)MPI_Allreduce(MPI_IN_PLACE, &largest, 1, MPI_DOUBLE, MPI_MAX, p->communicator);
    KILN_TRY(kiln_tile_pool(p, &data->surface, largest, points, gains, error));
    *most = 0.0;
    for (size_t i = 0; i < count; i++) {
        gains[i] /= (double)data->samples_taken[i] * (double)data->samples_taken[i];
        *most = fmax(*most, gains[i]);
    }
    (void)MPI_Allreduce(MPI_IN_PLACE, most, 1, MPI_DOUBLE, MPI_MAX, p->communicator);
end:
    kiln_free(&points);
    return status;
}

int kiln_round_senders(const struct kiln_integrate_params *p, const struct kiln_rank_data *data,
                       const struct kiln_part_survey *survey, const struct kiln_round *round, struct kiln_error *error)
{
    const size_t count = data->surface.tile_run_count;
    double *gains = NULL, most = 0.0;
    int status = kiln_allocate(&gains, count, sizeof *gains, "the noise of the tiles", error);
    KILN_TRY(kiln_agree(p->communicator, status, error));
    KILN_TRY(find_gains(p, data, survey, gains, &most, error));
    const size_t least = least_bin(p, data, gains, most, kiln_round_times(round->to) - kiln_round_times(round->from));
    for (size_t i = 0; i < count; i++)
        if (bin_of(gains[i], most) >= least)
            data->samples[i] = UINT32_MAX;
end:
    kiln_free(&gains);
    return status;
}
