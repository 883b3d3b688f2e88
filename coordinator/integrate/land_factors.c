#include "coordinator/integrate/land_factors.h"

#include <math.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

#define UNIT 4294967296.0 /* of a region's largest moment, in sums */

enum { TILES = 8, REGIONS_MOST = 1 << 16 };

/* Of a region and one of its techniques: what the factor is the ratio of. */
enum { ABOVE, BELOW, PARTS };
struct ratio {
    double of[KILN_CAUSTIC_GATHERS][PARTS];
};
struct sums {
    uint64_t of[KILN_CAUSTIC_GATHERS][PARTS];
};

int kiln_land_factors_create(struct kiln_land_factors *f, const struct kiln_surface *s, struct kiln_error *error)
{
    uint64_t tiles = TILES; /* of a region */
    while ((s->tile_count + tiles - 1) / tiles > REGIONS_MOST)
        tiles *= 2;
    f->regions = (size_t)((s->tile_count + tiles - 1) / tiles);
    int status = kiln_allocate(&f->of, f->regions, sizeof *f->of, "the factors of techniques", error);
    if (status == KILN_OK)
        status = kiln_allocate(&f->region_of, s->count, sizeof *f->region_of, "the regions of points", error);
    for (size_t r = 0; status == KILN_OK && r < f->regions; r++)
        f->of[r] = kiln_caustic_factors_alike;
    for (size_t t = 0; status == KILN_OK && t < s->tile_run_count; t++) {
        const struct kiln_tile_run *run = &s->tile_runs[t];
        const uint64_t first = kiln_own_of_global(s, run->first).at;
        for (uint32_t k = 0; k < run->count; k++)
            f->region_of[first + k] = (uint32_t)((s->lightmaps[run->map].tile_first + run->tile) / tiles);
    }
    return status;
}

void kiln_land_factors_release(struct kiln_land_factors *f)
{
    kiln_free(&f->of);
    kiln_free(&f->region_of);
    f->regions = 0;
}

static void parts_of(enum kiln_mis mis, const struct kiln_caustic_moments *m, struct ratio *parts)
{
    for (int t = 0; t < KILN_CAUSTIC_GATHERS; t++) {
        parts->of[t][ABOVE] = (double)(mis == KILN_MIS_VARIANCE ? m->square[t] : m->variance[t]);
        parts->of[t][BELOW] = (double)(mis == KILN_MIS_VARIANCE ? m->variance[t] : m->net[t]);
    }
}

static double factor_of(const uint64_t sums[PARTS])
{
    if (sums[ABOVE] == 0 || sums[BELOW] == 0)
        return 1.0;
    return fmax(1.0 / KILN_LAND_FACTOR_MOST, fmin((double)sums[ABOVE] / (double)sums[BELOW], KILN_LAND_FACTOR_MOST));
}

/* By the factor of hits. */
static struct kiln_caustic_factors factors_of(const struct sums *sums)
{
    const double hit = factor_of(sums->of[KILN_CAUSTIC_HIT]), sample = factor_of(sums->of[KILN_CAUSTIC_SAMPLE]);
    return (struct kiln_caustic_factors){(float)(sample / hit), (float)(1.0 / hit)};
}

/* The largest moment of a point of each region and technique. */
static void find_most(const struct kiln_land_factors *f, enum kiln_mis mis, const struct kiln_caustic_moments *moments,
                      size_t count, struct ratio *most)
{
    for (size_t i = 0; i < count; i++) {
        struct ratio parts;
        parts_of(mis, &moments[i], &parts);
        for (int t = 0; t < KILN_CAUSTIC_GATHERS; t++)
            most[f->region_of[i]].of[t][0] =
                fmax(most[f->region_of[i]].of[t][0], fmax(parts.of[t][ABOVE], parts.of[t][BELOW]));
    }
}

static void add_up(const struct kiln_land_factors *f, enum kiln_mis mis, const struct kiln_caustic_moments *moments,
                   size_t count, const struct ratio *most, struct sums *sums)
{
    for (size_t i = 0; i < count; i++) {
        struct ratio parts;
        const uint32_t r = f->region_of[i];
        parts_of(mis, &moments[i], &parts);
        for (int t = 0; t < KILN_CAUSTIC_GATHERS; t++)
            for (int p = 0; p < PARTS && most[r].of[t][0] > 0.0; p++)
                sums[r].of[t][p] += (uint64_t)(UNIT * (parts.of[t][p] / most[r].of[t][0]));
    }
}

int kiln_land_factors_find(struct kiln_land_factors *f, MPI_Comm communicator, enum kiln_mis mis,
                           const struct kiln_caustic_moments *moments, const struct kiln_surface *s,
                           struct kiln_error *error)
{
    const int each = KILN_CAUSTIC_GATHERS * PARTS;
    struct ratio *most = NULL;
    struct sums *sums = NULL;
    int status = kiln_allocate(&most, f->regions, sizeof *most, "the moments of techniques", error);
    if (status == KILN_OK)
        status = kiln_allocate(&sums, f->regions, sizeof *sums, "the moments of techniques", error);
    status = kiln_agree(communicator, status, error);
    if (status == KILN_OK) {
        find_most(f, mis, moments, s->count, most);
        (void)MPI_Allreduce(MPI_IN_PLACE, most, each * (int)f->regions, MPI_DOUBLE, MPI_MAX, communicator);
        add_up(f, mis, moments, s->count, most, sums);
        (void)MPI_Allreduce(MPI_IN_PLACE, sums, each * (int)f->regions, MPI_UINT64_T, MPI_SUM, communicator);
        for (size_t r = 0; r < f->regions; r++)
            f->of[r] = factors_of(&sums[r]);
    }
    kiln_free(&most);
    kiln_free(&sums);
    return status;
}

bool kiln_land_factors_sane(const struct kiln_land_factors *f)
{
    const float most = (float)(KILN_LAND_FACTOR_MOST * KILN_LAND_FACTOR_MOST);
    for (size_t r = 0; r < f->regions; r++)
        if (!(f->of[r].sample >= 1.0f / most && f->of[r].sample <= most && f->of[r].land >= 1.0f / most &&
              f->of[r].land <= most))
            return false;
    return true;
}
