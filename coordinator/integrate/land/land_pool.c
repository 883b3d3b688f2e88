#include "coordinator/integrate/land/land_pool.h"

#include <math.h>

#include "coordinator/integrate/land/land_state.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

/* Least numbers of equal paths that light must come from. A point whose light is of fewer than PATHS is noisy. If the
 * light of all noisy points of a lightmap together is of fewer than PATHS_OF_ALL, it is left out. */
#define PATHS 4.0
#define PATHS_OF_ALL 2.0

enum { POINTS_A_MAP = 16 }; /* of a thread, for each lightmap */

/* Sums over the noisy points of a lightmap; ALL is the area of all its points. Powers are per iteration. */
enum { ALL, AREA, IRRADIANCE, INCIDENT = IRRADIANCE + 3, LANDED = INCIDENT + 3, OWN, VARIED, SUMS };

struct pool {
    struct kiln_exact_sum of[SUMS];
};

/* Pools of noisy points, one for each lightmap of whole texels. That lightmap has part 0 of divided texels, too.
 * Further parts are in lightmaps of their own; their points share the pool of part 0. */
struct pools {
    struct pool *maps; /* `count` for each thread that sums up; the first have all in the end */
    size_t count, threads;
    double units[SUMS], iterations;
};

static bool is_noisy(const struct kiln_merged *m)
{
    const double light = kiln_luminance(m->irradiance);
    return light > 0.0 && PATHS * m->square > light * light;
}

static void set_units(struct pools *p, const struct kiln_integrate_params *params)
{
    const double power = kiln_luminance(params->emission->emitted), area = params->area;
    p->units[ALL] = p->units[AREA] = kiln_exact_unit(area);
    for (int k = IRRADIANCE; k < LANDED; k++)
        p->units[k] = kiln_exact_unit(power);
    p->units[LANDED] = p->units[OWN] = kiln_exact_unit(power * power);
    p->units[VARIED] = kiln_exact_unit(area > 0.0 ? power * power / area : 1.0);
}

static void add(const struct pools *p, uint32_t map, int which, double value)
{
    kiln_exact_add(&p->maps[map].of[which], value, 1.0 / p->units[which]);
}

static double value_of(const struct pools *p, uint32_t map, int which)
{
    return kiln_exact_value(&p->maps[map].of[which], p->units[which]);
}

static void add_point(const struct pools *p, uint32_t map, double area, const struct kiln_merged *m,
                      const struct kiln_landing_sum *landed)
{
    const double once = 1.0 / p->iterations, light = kiln_luminance(m->irradiance) * once;
    add(p, map, AREA, area);
    for (int c = 0; c < 3; c++) {
        add(p, map, IRRADIANCE + c, area * m->irradiance[c] * once);
        add(p, map, INCIDENT + c, area * m->incident[c] * once);
    }
    add(p, map, LANDED, landed->square * once * once);
    add(p, map, OWN, area * area * m->square * once * once);
    add(p, map, VARIED, area * fmax(light * light - m->square * once * once, 0.0));
}

static void collect(struct kiln_landing *l, const struct pools *p, uint32_t map, size_t at)
{
    add(p, map, ALL, (double)l->lit[at]);
    if (is_noisy(&l->merged[at]))
        add_point(p, map, (double)l->lit[at], &l->merged[at], &l->gathered[at]);
}

/* Calls `visit` for each of this rank's points that can be lit, on several threads, each of which has some tile
 * runs. */
static void for_lit(struct kiln_landing *l, struct pools *p,
                    void (*visit)(struct kiln_landing *, const struct pools *, uint32_t map, size_t at))
{
    const struct kiln_surface *s = &l->solution->own->surface;
#pragma omp parallel for num_threads((int)p->threads) schedule(static, 1)
    for (size_t part = 0; part < p->threads; part++) {
        struct pools own = *p;
        own.maps += visit == collect ? part * p->count : 0;
        for (size_t f = s->tile_run_count * part / p->threads; f < s->tile_run_count * (part + 1) / p->threads; f++) {
            struct kiln_point_cursor at = kiln_point_first(s, f);
            for (uint32_t k = 0; k < s->tile_runs[f].count; k++, kiln_point_next(s, &at))
                if (l->lit[at.point.at] > 0.0f)
                    visit(l, &own, at.map % s->whole_maps, at.point.at);
        }
    }
}

/* Adds the sums of all threads to those of the first. They are exact, so their order does not matter. */
static void add_threads(struct pools *p)
{
    for (size_t i = p->count; i < p->threads * p->count; i++)
        for (int k = 0; k < SUMS; k++)
            p->maps[i % p->count].of[k].value += p->maps[i].of[k].value;
}

/* Variance of the power of a lightmap's noisy points, W2. */
static double variance_of(const struct pools *p, uint32_t map)
{
    return fmax(value_of(p, map, LANDED), value_of(p, map, OWN));
}

static double power_of(const struct pools *p, uint32_t map)
{
    const double rgb[3] = {value_of(p, map, IRRADIANCE), value_of(p, map, IRRADIANCE + 1),
                           value_of(p, map, IRRADIANCE + 2)};
    return kiln_luminance(rgb);
}

static bool is_left_out(const struct pools *p, uint32_t map)
{
    const double power = power_of(p, map);
    return PATHS_OF_ALL * variance_of(p, map) > power * power;
}

/* A point gets its share. */
static void share_out(struct kiln_landing *l, const struct pools *p, uint32_t map, size_t at)
{
    const double area = value_of(p, map, AREA), mean = power_of(p, map) / area,
                 chance = variance_of(p, map) / (area * area), all = p->iterations * p->iterations;
    struct kiln_merged *m = &l->merged[at];
    if (!is_noisy(m))
        return;
    if (is_left_out(p, map)) {
        const double whole = value_of(p, map, ALL);
        *m = (struct kiln_merged){.square = variance_of(p, map) / (whole * whole) * all};
        return;
    }
    const double varied = fmax(value_of(p, map, VARIED) / area - mean * mean, 0.0);
    *m = (struct kiln_merged){.square = (chance + varied) * all, .half = mean * p->iterations};
    for (int c = 0; c < 3; c++) {
        m->irradiance[c] = value_of(p, map, IRRADIANCE + c) / area * p->iterations;
        m->incident[c] = value_of(p, map, INCIDENT + c) / area * p->iterations;
    }
}

/* Sums up the light that is left out, W. */
static void tell(const struct pools *p, double unfound[3])
{
    for (int c = 0; c < 3; c++)
        unfound[c] = 0.0;
    for (uint32_t map = 0; map < p->count; map++)
        for (int c = 0; c < 3 && is_left_out(p, map); c++)
            unfound[c] += value_of(p, map, INCIDENT + c);
}

/* As many threads as have more points to sum up than lightmaps to sum up in. */
static size_t threads_for(const struct kiln_surface *own, uint32_t threads)
{
    const size_t most = (size_t)(own->count / (POINTS_A_MAP * ((uint64_t)own->whole_maps + 1))) + 1;
    return most < threads ? most : threads;
}

int kiln_landing_pool(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_surface *own = &l->solution->own->surface;
    struct pools p = {.count = own->whole_maps, .iterations = (double)kiln_landing_iterations(l)};
    p.threads = threads_for(own, l->params->threads);
    set_units(&p, l->params);
    int status;
    KILN_TRY(kiln_agree(l->params->communicator,
                        kiln_allocate(&p.maps, p.threads * p.count, sizeof *p.maps, "the light of objects", error),
                        error));
    for_lit(l, &p, collect);
    add_threads(&p);
    KILN_TRY(kiln_exact_reduce(l->params->communicator, p.maps->of, p.count * SUMS, error));
    for_lit(l, &p, share_out);
    tell(&p, kiln_solution_step(l->solution)->energy.unfound);
end:
    kiln_free(&p.maps);
    return status;
}
