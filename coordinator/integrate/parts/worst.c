#include "coordinator/integrate/parts/worst.h"

#include <math.h>

#include "coordinator/integrate/parts/published.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

#define LEAST 1e-3      /* of all texels: a smaller object does not count */
#define SQUARE_MOST 1e4 /* a tile run's squared relative error counts as no more */
#define UNIT 0x1p-60    /* of exact sums of squared relative errors */
enum { POINTS = 64 };   /* of a tile run, at most */

/* Errors of objects while they are summed up. */
struct sums {
    struct kiln_exact_sum *squares; /* of each object, times texels */
    uint64_t *texels;               /* likewise */
    size_t objects;
};

/* One of so many tile runs is looked at. */
static uint64_t every(const struct kiln_surface *surface)
{
    const uint64_t runs = surface->point_count / POINTS, some = runs / KILN_WORST_TILE_RUNS;
    return some > 0 ? some : 1;
}

static bool is_looked_at(const struct kiln_surface *surface, const struct kiln_tile_run *run)
{
    return run->first.at / POINTS % every(surface) == 0;
}

/* Collective. The error of all texels that are looked at, or of those of one object; fills in `sums` if it is given. */
static int measure(const struct kiln_integrate_params *p, const struct kiln_rank_data *data, const uint32_t *object,
                   struct sums *sums, double *reached, struct kiln_error *error)
{
    const struct kiln_surface *s = &data->surface;
    struct kiln_published published;
    const double unit = kiln_exact_unit(kiln_luminance(p->emission->emitted));
    const int status = kiln_published_begin(&published, p, data, 1.0, unit, error);
    for (size_t i = 0; status == KILN_OK && i < s->tile_run_count; i++) {
        const struct kiln_tile_run *run = &s->tile_runs[i];
        const uint32_t of = kiln_map_object(s, run->map);
        if (!is_looked_at(s, run) || (object != NULL && of != *object))
            continue;
        const double own = kiln_published_tile(&published, data, run);
        if (sums == NULL)
            continue;
        kiln_exact_add(&sums->squares[of], (double)run->count * fmin(own * own, SQUARE_MOST), 1.0 / UNIT);
        sums->texels[of] += run->count;
    }
    if (status == KILN_OK)
        *reached = kiln_published_reached(&published, p->communicator);
    kiln_published_release(&published);
    return status;
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
    struct sums sums = {.objects = data->surface.object_count};
    double all = 0.0, own = 0.0;
    size_t object = 0;
    int status = kiln_allocate(&sums.squares, sums.objects, sizeof *sums.squares, "the objects' errors", error);
    if (status == KILN_OK)
        status = kiln_allocate(&sums.texels, sums.objects, sizeof *sums.texels, "the objects' errors", error);
    KILN_TRY(kiln_agree(p->communicator, status, error));
    KILN_TRY(measure(p, data, NULL, &sums, &all, error));
    KILN_TRY(choose(p, &sums, &object, error));
    if (object == sums.objects)
        goto end;
    const uint32_t number = (uint32_t)object;
    KILN_TRY(measure(p, data, &number, NULL, &own, error));
    *worst = (struct kiln_worst_object){
        .known = all > 0.0 && own > 0.0, .object = number, .published = all > 0.0 ? own * reached / all : 0.0};
end:
    kiln_free(&sums.squares);
    kiln_free(&sums.texels);
    return status;
}
