#include "coordinator/bake/volume/probe_fill.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/bake/points/surface_exchange.h"
#include "worker/base/memory.h"

/* The floats of a probe's light: its coefficients, then its light along the axes. */
enum { SHELLS = 8, HARMONICS = 27, LIGHT = HARMONICS + 18 };

/* Request of a rank to the owner of a probe, and the answer. */
struct request {
    uint64_t probe, rank;
};
_Static_assert(sizeof(((struct kiln_probe_result *)NULL)->radiance) == HARMONICS * sizeof(float), "coefficients");
struct light {
    uint64_t probe;
    float values[LIGHT];
};

struct fill {
    struct kiln_volume_result *volume;
    const struct kiln_surface_exchange *exchange;
    uint64_t rank, ranks, total;
    uint64_t *buried; /* a bit a probe of the whole grid */
    struct request *requests;
    size_t request_count, request_room;
    struct light *lights;
    size_t light_count, light_room;
    int status;
    struct kiln_error *error;
};

static bool is_buried(const struct fill *f, uint64_t probe) { return (f->buried[probe / 64] >> probe % 64 & 1) != 0; }

static bool is_own(const struct fill *f, uint64_t probe) { return probe - f->volume->first < f->volume->count; }

/* Returns the rank that owns the probe. Rank r has those from total * r / ranks on. */
static uint64_t owner_of(const struct fill *f, uint64_t probe)
{
    uint64_t r = probe * f->ranks / f->total;
    while (f->total * (r + 1) / f->ranks <= probe)
        r++;
    return r;
}

/* ---- probes in the neighbourhood of a probe ---- */

typedef void (*visitor)(struct fill *f, uint64_t probe, double weight, void *context);

/* Visits the probes of one shell around a grid position, z outermost; returns their number. */
static uint64_t visit_shell(struct fill *f, const int64_t at[3], int64_t shell, visitor visit, void *context)
{
    const struct kiln_volume_result *v = f->volume;
    uint64_t found = 0;
    for (int64_t dz = -shell; dz <= shell; dz++)
        for (int64_t dy = -shell; dy <= shell; dy++)
            for (int64_t dx = -shell; dx <= shell; dx++) {
                const int64_t d[3] = {dx, dy, dz};
                bool outside = false, border = false;
                double square = 0.0;
                for (int a = 0; a < 3; a++) {
                    outside = outside || at[a] + d[a] < 0 || at[a] + d[a] >= (int64_t)v->size[a];
                    border = border || d[a] == shell || d[a] == -shell;
                    square += (double)(d[a] * d[a]) * v->spacing[a] * v->spacing[a];
                }
                if (outside || !border)
                    continue;
                const uint64_t probe = ((uint64_t)(at[2] + dz) * v->size[1] + (uint64_t)(at[1] + dy)) * v->size[0] +
                                       (uint64_t)(at[0] + dx);
                if (is_buried(f, probe))
                    continue;
                visit(f, probe, 1.0 / square, context);
                found++;
            }
    return found;
}

static bool visit_nearest(struct fill *f, uint64_t probe, visitor visit, void *context)
{
    const uint64_t *size = f->volume->size;
    const int64_t at[3] = {(int64_t)(probe % size[0]), (int64_t)(probe / size[0] % size[1]),
                           (int64_t)(probe / (size[0] * size[1]))};
    for (int64_t shell = 1; shell <= SHELLS; shell++)
        if (visit_shell(f, at, shell, visit, context) > 0)
            return true;
    return false;
}

/* ---- the light of other ranks' probes ---- */

static void keep_status(struct fill *f, int status) { f->status = f->status == KILN_OK ? status : f->status; }

static void add_request(struct fill *f, const struct request *request)
{
    const int status = kiln_grow(&f->requests, &f->request_room, f->request_count + 1, sizeof *f->requests,
                                 "probes to ask for", f->error);
    keep_status(f, status);
    if (status == KILN_OK)
        f->requests[f->request_count++] = *request;
}

static void want(struct fill *f, uint64_t probe, double weight, void *context)
{
    (void)weight, (void)context;
    if (!is_own(f, probe) && f->status == KILN_OK)
        add_request(f, &(struct request){probe, f->rank});
}

static int by_probe(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

static int by_rank(const void *a, const void *b)
{
    const uint64_t x = ((const struct request *)a)->rank, y = ((const struct request *)b)->rank;
    return x != y ? (x > y) - (x < y) : by_probe(a, b);
}

/* Sorts the requests by probe, which is the order of owners too, and removes duplicates. */
static void sort_requests(struct fill *f)
{
    size_t kept = 0;
    if (f->request_count > 0)
        qsort(f->requests, f->request_count, sizeof *f->requests, by_probe);
    for (size_t i = 0; i < f->request_count; i++)
        if (kept == 0 || f->requests[kept - 1].probe != f->requests[i].probe)
            f->requests[kept++] = f->requests[i];
    f->request_count = kept;
}

static void take_requests(void *taker, const void *records, size_t count)
{
    struct fill *f = taker;
    for (size_t i = 0; i < count && f->status == KILN_OK; i++)
        add_request(f, (const struct request *)records + i);
}

static void take_lights(void *taker, const void *records, size_t count)
{
    struct fill *f = taker;
    const int status =
        kiln_grow(&f->lights, &f->light_room, f->light_count + count, sizeof *f->lights, "probes' light", f->error);
    keep_status(f, status);
    if (status == KILN_OK && count > 0) {
        memcpy(f->lights + f->light_count, records, count * sizeof *f->lights);
        f->light_count += count;
    }
}

static struct light light_of(const struct fill *f, uint64_t probe)
{
    const struct kiln_probe_result *p = &f->volume->probes[probe - f->volume->first];
    struct light light = {.probe = probe};
    memcpy(light.values, p->radiance, sizeof p->radiance);
    memcpy(light.values + HARMONICS, p->irradiance_axes, sizeof p->irradiance_axes);
    return light;
}

/* Collective. Sends the requests to the owners. The requests received replace them. */
static int send_requests(struct fill *f, size_t *counts)
{
    struct request *own = f->requests;
    const size_t count = f->request_count;
    for (size_t i = 0; i < count; i++)
        counts[owner_of(f, own[i].probe)]++;
    f->requests = NULL;
    f->request_count = f->request_room = 0;
    const int status =
        f->exchange->alltoall(f->exchange->context, f->status, own, counts, sizeof *own, take_requests, f, f->error);
    kiln_free(&own);
    return status != KILN_OK ? status : f->status;
}

/* Collective. Answers them. */
static int send_lights(struct fill *f, int status, size_t *counts)
{
    struct light *lights = NULL;
    memset(counts, 0, f->ranks * sizeof *counts);
    if (status == KILN_OK)
        status = kiln_allocate(&lights, f->request_count, sizeof *lights, "probes' light", f->error);
    if (status == KILN_OK && f->request_count > 0)
        qsort(f->requests, f->request_count, sizeof *f->requests, by_rank);
    for (size_t i = 0; status == KILN_OK && i < f->request_count; i++) {
        lights[i] = light_of(f, f->requests[i].probe);
        counts[f->requests[i].rank]++;
    }
    status =
        f->exchange->alltoall(f->exchange->context, status, lights, counts, sizeof *lights, take_lights, f, f->error);
    kiln_free(&lights);
    if (f->light_count > 0)
        qsort(f->lights, f->light_count, sizeof *f->lights, by_probe);
    return status != KILN_OK ? status : f->status;
}

/* ---- means ---- */

struct sums {
    double values[LIGHT], weight;
};

static void add_light(struct fill *f, uint64_t probe, double weight, void *context)
{
    struct sums *sums = context;
    struct light own;
    const struct light *light = &own;
    if (is_own(f, probe))
        own = light_of(f, probe);
    else
        light = bsearch(&probe, f->lights, f->light_count, sizeof *f->lights, by_probe);
    for (int i = 0; i < LIGHT; i++)
        sums->values[i] += weight * (double)light->values[i];
    sums->weight += weight;
}

static void fill_one(struct fill *f, uint64_t own)
{
    struct sums sums = {.weight = 0.0};
    if (!visit_nearest(f, f->volume->first + own, add_light, &sums))
        return;
    struct kiln_probe_result *p = (struct kiln_probe_result *)(uintptr_t)&f->volume->probes[own];
    struct kiln_probe_place *place = (struct kiln_probe_place *)(uintptr_t)&f->volume->places[own];
    float values[LIGHT];
    for (int i = 0; i < LIGHT; i++)
        values[i] = (float)(sums.values[i] / sums.weight);
    memcpy(p->radiance, values, sizeof p->radiance);
    memcpy(p->irradiance_axes, values + HARMONICS, sizeof p->irradiance_axes);
    place->state = KILN_PROBE_FILLED;
}

/* ---- all of it ---- */

static void mark_buried(void *taker, const void *records, size_t count)
{
    struct fill *f = taker;
    for (size_t i = 0; i < count; i++) {
        const uint64_t probe = ((const uint64_t *)records)[i];
        f->buried[probe / 64] |= 1ull << probe % 64;
    }
}

/* Collective. Tells all ranks which probes are buried; `all` receives their total number. */
static int share_buried(struct fill *f, uint64_t *all, struct kiln_error *error)
{
    const struct kiln_volume_result *v = f->volume;
    uint64_t *own = NULL;
    size_t count = 0;
    int status;
    KILN_TRY(kiln_allocate(&f->buried, f->total / 64 + 1, sizeof *f->buried, "probes inside geometry", error));
    KILN_TRY(kiln_allocate(&own, v->count, sizeof *own, "probes inside geometry", error));
    for (uint64_t i = 0; i < v->count; i++)
        if (v->places[i].state == KILN_PROBE_BURIED || v->places[i].state == KILN_PROBE_FILLED)
            own[count++] = v->first + i;
end:
    status = f->exchange->allgather(f->exchange->context, status, own, count, sizeof *own, mark_buried, f, error);
    *all = count;
    if (status == KILN_OK)
        status = f->exchange->sum(f->exchange->context, status, all, NULL, 1, error);
    kiln_free(&own);
    return status;
}

/* Collective. */
static int fill_buried(struct fill *f, struct kiln_error *error)
{
    const struct kiln_volume_result *v = f->volume;
    size_t *counts = NULL;
    keep_status(f, kiln_allocate(&counts, f->ranks, sizeof *counts, "probes to ask for", error));
    for (uint64_t i = 0; i < v->count; i++)
        if (is_buried(f, v->first + i))
            (void)visit_nearest(f, v->first + i, want, NULL);
    sort_requests(f);
    f->status = f->exchange->agree(f->exchange->context, f->status, error);
    int status = f->status;
    if (status == KILN_OK) {
        status = send_requests(f, counts);
        status = send_lights(f, status, counts);
    }
    for (uint64_t i = 0; status == KILN_OK && i < v->count; i++)
        if (is_buried(f, v->first + i))
            fill_one(f, i);
    kiln_free(&counts);
    return f->exchange->agree(f->exchange->context, status, error);
}

int kiln_probe_fill(MPI_Comm communicator, struct kiln_volume_result *volume, struct kiln_error *error)
{
    struct kiln_surface_meeting meeting = {.communicator = communicator};
    const struct kiln_surface_exchange exchange = kiln_surface_exchange_over(&meeting);
    struct fill f = {.volume = volume,
                     .exchange = &exchange,
                     .total = volume->size[0] * volume->size[1] * volume->size[2],
                     .status = KILN_OK,
                     .error = error};
    int rank, ranks;
    uint64_t buried = 0;
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    f.rank = (uint64_t)rank;
    f.ranks = (uint64_t)ranks;
    int status = share_buried(&f, &buried, error);
    if (status == KILN_OK && buried > 0)
        status = fill_buried(&f, error);
    kiln_free(&f.buried);
    kiln_free(&f.requests);
    kiln_free(&f.lights);
    return status;
}
