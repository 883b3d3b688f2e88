#include "coordinator/integrate/land_factors.h"

#include <math.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

#define UNIT 4294967296.0 /* of a region's largest moment of a kind, in sums */

enum { TILES = 8, REGIONS_MOST = 1 << 16, ROUNDS = 64 };

/* Of a region, the moments that count: of --mis variance and correlation for each technique what the factor is the
 * ratio of, one after the other; the products of --mis optimal. */
struct numbers {
    double of[KILN_CAUSTIC_PRODUCTS];
};
struct sums {
    int64_t of[KILN_CAUSTIC_PRODUCTS];
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

/* ---- sums ---- */

static struct numbers numbers_of(enum kiln_mis mis, const struct kiln_caustic_moments *m)
{
    struct numbers n = {{0.0}};
    for (int i = 0; i < KILN_CAUSTIC_PRODUCTS && mis == KILN_MIS_OPTIMAL; i++)
        n.of[i] = (double)m->product[i];
    for (int t = 0; t < KILN_CAUSTIC_GATHERS && mis != KILN_MIS_OPTIMAL; t++) {
        n.of[2 * t] = (double)(mis == KILN_MIS_VARIANCE ? m->square[t] : m->variance[t]);
        n.of[2 * t + 1] = (double)(mis == KILN_MIS_VARIANCE ? m->variance[t] : m->net[t]);
    }
    return n;
}

/* The largest moments of a point, of each region and kind. */
static void find_most(const struct kiln_land_factors *f, enum kiln_mis mis, const struct kiln_caustic_moments *moments,
                      size_t count, struct numbers *most)
{
    for (size_t i = 0; i < count; i++) {
        const struct numbers n = numbers_of(mis, &moments[i]);
        double *of = most[f->region_of[i]].of;
        for (int k = 0; k < KILN_CAUSTIC_PRODUCTS; k++)
            of[k] = fmax(of[k], fabs(n.of[k]));
    }
}

static void add_up(const struct kiln_land_factors *f, enum kiln_mis mis, const struct kiln_caustic_moments *moments,
                   size_t count, const struct numbers *most, struct sums *sums)
{
    for (size_t i = 0; i < count; i++) {
        const struct numbers n = numbers_of(mis, &moments[i]);
        const uint32_t r = f->region_of[i];
        for (int k = 0; k < KILN_CAUSTIC_PRODUCTS; k++)
            if (most[r].of[k] > 0.0)
                sums[r].of[k] += (int64_t)(UNIT * (n.of[k] / most[r].of[k]));
    }
}

/* ---- what follows from them ---- */

static double ratio(double above, double below)
{
    if (!(above > 0.0) || !(below > 0.0))
        return 1.0;
    return fmax(1.0 / KILN_LAND_FACTOR_MOST, fmin(above / below, KILN_LAND_FACTOR_MOST));
}

static double within(double x) { return fmax(-1.0, fmin(x, 1.0)); }

/* A alpha = b of two unknowns from -1 to 1: each in turn, with the other held, makes the variance less. */
static void solve(const double a[3], const double b[2], double alpha[2])
{
    alpha[0] = alpha[1] = 0.0;
    for (int i = 0; i < ROUNDS; i++) {
        if (a[0] > 0.0)
            alpha[0] = within((b[0] - a[1] * alpha[1]) / a[0]);
        if (a[2] > 0.0)
            alpha[1] = within((b[1] - a[1] * alpha[0]) / a[2]);
    }
}

static struct kiln_caustic_factors factors_of(enum kiln_mis mis, const double n[KILN_CAUSTIC_PRODUCTS])
{
    struct kiln_caustic_factors f = kiln_caustic_factors_alike;
    double alpha[2];
    if (mis == KILN_MIS_OPTIMAL) {
        solve(n, (const double[2]){-n[3], -n[4]}, alpha);
        f.exchange[0] = (float)alpha[0];
        f.exchange[1] = (float)alpha[1];
        return f;
    }
    const double hit = ratio(n[0], n[1]), sample = ratio(n[2], n[3]);
    f.sample = (float)(sample / hit);
    f.land = (float)(1.0 / hit);
    return f;
}

int kiln_land_factors_find(struct kiln_land_factors *f, MPI_Comm communicator, enum kiln_mis mis,
                           const struct kiln_caustic_moments *moments, const struct kiln_surface *s,
                           struct kiln_error *error)
{
    const int all = KILN_CAUSTIC_PRODUCTS * (int)f->regions;
    struct numbers *most = NULL;
    struct sums *sums = NULL;
    int status = kiln_allocate(&most, f->regions, sizeof *most, "the moments of techniques", error);
    if (status == KILN_OK)
        status = kiln_allocate(&sums, f->regions, sizeof *sums, "the moments of techniques", error);
    status = kiln_agree(communicator, status, error);
    if (status == KILN_OK) {
        find_most(f, mis, moments, s->count, most);
        (void)MPI_Allreduce(MPI_IN_PLACE, most, all, MPI_DOUBLE, MPI_MAX, communicator);
        add_up(f, mis, moments, s->count, most, sums);
        (void)MPI_Allreduce(MPI_IN_PLACE, sums, all, MPI_INT64_T, MPI_SUM, communicator);
        for (size_t r = 0; r < f->regions; r++) {
            for (int k = 0; k < KILN_CAUSTIC_PRODUCTS; k++)
                most[r].of[k] *= (double)sums[r].of[k] / UNIT;
            f->of[r] = factors_of(mis, most[r].of);
        }
    }
    kiln_free(&most);
    kiln_free(&sums);
    return status;
}

static bool is_factor(float x)
{
    const float most = (float)(KILN_LAND_FACTOR_MOST * KILN_LAND_FACTOR_MOST);
    return x >= 1.0f / most && x <= most;
}

static bool is_exchange(float x) { return x >= -1.0f && x <= 1.0f; }

bool kiln_land_factors_sane(const struct kiln_land_factors *f)
{
    bool sane = true;
    for (size_t r = 0; r < f->regions && sane; r++)
        sane = is_factor(f->of[r].sample) && is_factor(f->of[r].land) && is_exchange(f->of[r].exchange[0]) &&
               is_exchange(f->of[r].exchange[1]);
    return sane;
}
