#include "coordinator/integrate/parts/worst.h"

#include <math.h>

#include "coordinator/integrate/parts/part_errors.h"
#include "coordinator/integrate/parts/published.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

#define LEAST 1e-3      /* of all texels: a smaller object does not count */
#define SQUARE_MOST 1e4 /* a tile run's squared relative error counts as no more */
#define UNIT 0x1p-60    /* of exact sums of squared relative errors */

/* Errors of objects while they are summed up. */
struct sums {
    struct kiln_exact_sum *squares; /* of each object, times texels */
    uint64_t *texels;               /* likewise */
    size_t objects;
};

/* Adds up the errors of all objects. */
static void add(const struct kiln_published *published, const struct kiln_rank_data *data, struct sums *sums)
{
    for (size_t i = 0; i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        const uint32_t of = kiln_map_object(&data->surface, run->map);
        const double own = (double)published->raw[i];
        kiln_exact_add(&sums->squares[of], (double)published->weight[i] * fmin(own * own, SQUARE_MOST), 1.0 / UNIT);
        sums->texels[of] += published->weight[i];
    }
}

/* Collective. The error of raw light in one object. */
static double error_in(struct kiln_published *published, const struct kiln_rank_data *data, uint32_t object,
                       MPI_Comm communicator)
{
    for (size_t i = 0; i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        if (kiln_map_object(&data->surface, run->map) == object)
            kiln_published_goes_on(published, i);
    }
    kiln_published_gather(published, communicator);
    return kiln_published_raw_of_those(published);
}

/* The object with the largest root mean square; `objects` if none has any texels. */
static size_t largest(const struct sums *sums, double least)
{
    size_t worst = sums->objects;
    double most = -1.0;
    for (size_t o = 0; o < sums->objects; o++) {
        if (!(sums->texels[o] > 0) || (double)sums->texels[o] < least)
            continue;
        const double square = kiln_exact_value(&sums->squares[o], UNIT) / (double)sums->texels[o];
        if (square > most) {
            most = square;
            worst = o;
        }
    }
    return worst;
}

/* Collective. Adds up over the ranks, and chooses. */
static int choose(const struct kiln_integrate_params *p, struct sums *sums, size_t *worst, struct kiln_error *error)
{
    double all = 0.0;
    const int status = kiln_exact_reduce(p->communicator, sums->squares, sums->objects, error);
    (void)MPI_Allreduce(MPI_IN_PLACE, sums->texels, (int)sums->objects, MPI_UINT64_T, MPI_SUM, p->communicator);
    for (size_t o = 0; o < sums->objects; o++)
        all += (double)sums->texels[o];
    *worst = largest(sums, LEAST * all);
    if (*worst == sums->objects)
        *worst = largest(sums, 0.0);
    return status;
}

int kiln_worst_find(const struct kiln_integrate_params *p, const struct kiln_rank_data *data, double reached,
                    struct kiln_worst_object *worst, struct kiln_error *error)
{
    const struct kiln_part_survey survey = {.gain = 1.0}; /* errors of raw light are compared with one another alone */
    const double unit = kiln_exact_unit(kiln_luminance(p->emission->emitted));
    struct kiln_published published = {.raw = NULL};
    struct sums sums = {.objects = data->surface.object_count};
    size_t object = 0;
    int status = kiln_allocate(&sums.squares, sums.objects, sizeof *sums.squares, "the objects' errors", error);
    if (status == KILN_OK)
        status = kiln_allocate(&sums.texels, sums.objects, sizeof *sums.texels, "the objects' errors", error);
    KILN_TRY(kiln_agree(p->communicator, status, error));
    KILN_TRY(kiln_published_begin(&published, p, data, &survey, unit, error));
    add(&published, data, &sums);
    KILN_TRY(choose(p, &sums, &object, error));
    if (object == sums.objects)
        goto end;
    const double all = kiln_published_raw_normal(&published),
                 own = error_in(&published, data, (uint32_t)object, p->communicator);
    *worst = (struct kiln_worst_object){.known = all > 0.0 && own > 0.0,
                                        .object = (uint32_t)object,
                                        .published = all > 0.0 ? own * reached / all : 0.0};
end:
    kiln_published_release(&published);
    kiln_free(&sums.squares);
    kiln_free(&sums.texels);
    return status;
}
