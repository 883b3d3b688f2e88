#include "worker/backend/embree/directed.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/streams.h"
#include "worker/base/memory.h"
#include "worker/pass/bright.h"
#include "worker/sampling/sequence.h"

/* Receivers of a tile: four clusters of 4 x 4 texels, and points in no cluster. */
enum { RECEIVERS = 5 };

struct directed {
    const struct kiln_directions_parameters *p;
    uint32_t samples;
    float turn[KILN_TILE_TEXELS]; /* of point j */
    uint8_t receiver_of[KILN_TILE_TEXELS];
    struct kiln_bright_receiver receivers[RECEIVERS];
    uint32_t receiver_count;
    /* of the step under way */
    bool to_patch[RAY_LANES];
    uint32_t aimed_at[RAY_LANES]; /* target cluster of each ray; KILN_NO_CLUSTER: the ray is not used */
};

int directed_create(struct directed **directed, const struct kiln_directions_parameters *p,
                    const struct kiln_batch *part, struct kiln_error *error)
{
    struct directed *d = NULL;
    *directed = NULL;
    if (p->set != NULL && p->set_count != part->samples)
        return kiln_fail(error, KILN_USAGE, "a set of %u directions is for as many samples, not %u", p->set_count,
                         part->samples);
    int status = kiln_allocate(&d, 1, sizeof *d, "the directions pass", error);
    *directed = d;
    if (status != KILN_OK)
        return status;
    d->p = p;
    d->samples = part->samples;
    for (int i = 0; i < RECEIVERS && p->bright != NULL && status == KILN_OK; i++)
        status = kiln_allocate(&d->receivers[i].sums, p->bright->count, sizeof(double), "the bright patches", error);
    if (status != KILN_OK)
        directed_destroy(directed);
    return status;
}

void directed_destroy(struct directed **directed)
{
    for (int i = 0; i < RECEIVERS && *directed != NULL; i++)
        kiln_free(&(*directed)->receivers[i].sums);
    kiln_free(directed);
}

/* ---- choices of a tile run's points ---- */

/* Returns the receiver of a cluster, and initializes it at first use. */
static uint8_t receiver_with(struct directed *d, uint32_t cluster)
{
    uint8_t i = 0;
    while (i < d->receiver_count && d->receivers[i].cluster != cluster)
        i++;
    if (i == d->receiver_count) {
        d->receivers[d->receiver_count++].cluster = cluster;
        kiln_bright_begin(d->p->bright, d->samples, &d->receivers[i]);
    }
    return i;
}

void directed_begin(struct directed *d, const struct tile_run_rays *rays, const struct embree_backend *b,
                    size_t tile_run, uint32_t stream)
{
    const struct tile_run_frame *f = &rays->frame;
    const uint64_t first = b->surface->tile_runs[tile_run].first.at;
    d->receiver_count = 0;
    for (uint32_t j = 0; j < f->count; j++) {
        d->turn[j] = kiln_unit_float(kiln_gather_shift(kiln_hash2(f->key[j], stream), KILN_DIMENSION_V));
        if (d->p->bright != NULL)
            d->receiver_of[j] = receiver_with(d, d->p->bright->cluster_of[first + f->place[j]]);
    }
}

/* ---- rays ---- */

/* Index of the first cumulative sum above x. */
static uint32_t find_sum(const double *sums, uint32_t count, double x)
{
    uint32_t low = 0, high = count - 1;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (sums[middle] > x)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

/* Chooses a point by *u in [0, 1); *u becomes a new random number in [0, 1). */
static uint64_t choose(const struct kiln_bright *bright, const struct kiln_bright_receiver *r, double *u)
{
    const double x = *u * r->sums[bright->count - 1];
    const uint32_t c = find_sum(r->sums, bright->count, x);
    const double before = c > 0 ? r->sums[c - 1] : 0.0;
    const struct kiln_bright_cluster *cluster = &bright->clusters[c];
    double left = (x - before) / (r->sums[c] - before) * cluster->power;
    uint32_t i = cluster->first;
    while (i + 1 < cluster->end && left >= (double)bright->power[bright->members[i]])
        left -= (double)bright->power[bright->members[i++]];
    const double power = (double)bright->power[bright->members[i]];
    *u = power > 0.0 ? fmin(fmax(left / power, 0.0), 1.0) : 0.5;
    return bright->members[i];
}

static struct kiln_vec3 origin_of(const struct tile_run_rays *r, uint32_t l)
{
    return vec3(r->origin[0][l], r->origin[1][l], r->origin[2][l]);
}

static void aim_at_patch(struct directed *d, struct tile_run_rays *rays, const struct kiln_bright_receiver *r,
                         uint32_t k, uint32_t l)
{
    const struct kiln_bright *bright = d->p->bright;
    double u = kiln_unit_double(rays->scrambled[0][k] ^ rays->shift_u[l]);
    const double v = kiln_unit_double(rays->scrambled[1][k] ^ rays->shift_v[l]);
    const uint64_t point = choose(bright, r, &u);
    const struct kiln_patch *patch = &bright->points[point];
    const struct kiln_vec3 place = vec3_madd(
                               vec3_madd(patch->place, patch->edge_s, (float)(KILN_BRIGHT_SPREAD * (u - 0.5))),
                               patch->edge_t, (float)(KILN_BRIGHT_SPREAD * (v - 0.5))),
                           to = vec3_sub(place, origin_of(rays, l));
    const float length = vec3_length(to);
    d->to_patch[l] = true;
    d->aimed_at[l] =
        length > 0.0f && rays_aim(rays, l, vec3_scale(to, 1.0f / length)) ? bright->cluster_of[point] : KILN_NO_CLUSTER;
}

void directed_aim(struct directed *d, struct tile_run_rays *rays, uint32_t step, uint32_t lanes)
{
    for (uint32_t l = 0; l < lanes; l++) {
        const uint32_t j = rays->point[l], k = step * rays->copies + rays->copy[l];
        const struct kiln_bright_receiver *r = &d->receivers[d->receiver_of[j]];
        d->to_patch[l] = false;
        if (d->p->set != NULL) {
            const struct kiln_direction *to = &d->p->set[k];
            const float turn = to->turn + d->turn[j];
            rays_turn(rays, l, to->radius, turn < 1.0f ? turn : turn - 1.0f);
            rays->weight[l] = to->weight;
        } else if (d->p->bright != NULL && k >= r->by_cosine) {
            aim_at_patch(d, rays, r, k, l);
        }
    }
}

/* ---- weights ---- */

/* Density per steradian of a ray from `origin` along w at the parallelogram of a patch: squared distance over area and
 * cosine. 0: the ray misses it. */
static double density_to(const struct kiln_patch *patch, struct kiln_dvec3 origin, struct kiln_dvec3 w)
{
    const struct kiln_dvec3 s = dvec3_scale(dvec3_of(patch->edge_s), KILN_BRIGHT_SPREAD),
                            t = dvec3_scale(dvec3_of(patch->edge_t), KILN_BRIGHT_SPREAD), across = dvec3_cross(s, t),
                            to = dvec3_sub(dvec3_of(patch->place), origin);
    const double square = dvec3_dot(across, across), along = dvec3_dot(across, w),
                 distance = dvec3_dot(across, to) / along;
    if (!(dvec3_dot(dvec3_of(patch->normal), w) < 0.0) || !(distance > 0.0))
        return 0.0;
    const struct kiln_dvec3 at = dvec3_sub(dvec3_scale(w, distance), to);
    const double a = dvec3_dot(dvec3_cross(at, t), across) / square, b = dvec3_dot(dvec3_cross(s, at), across) / square;
    /* |along| is the area times the cosine */
    return fabs(a) <= 0.5 && fabs(b) <= 0.5 ? distance * distance / fabs(along) : 0.0;
}

/* Density q of worker/pass/directions.h, for the ray of lane l that has hit a point of cluster c. */
static double density_of(const struct kiln_bright *bright, const struct kiln_bright_receiver *r,
                         const struct tile_run_rays *rays, uint32_t l, uint32_t c)
{
    const struct kiln_bright_cluster *cluster = &bright->clusters[c];
    const struct kiln_dvec3 origin = dvec3_of(origin_of(rays, l)),
                            w = dvec3_of(vec3(rays->direction[0][l], rays->direction[1][l], rays->direction[2][l]));
    const double chance = (r->sums[c] - (c > 0 ? r->sums[c - 1] : 0.0)) / r->sums[bright->count - 1];
    double sum = 0.0;
    for (uint32_t i = cluster->first; i < cluster->end && chance > 0.0; i++)
        if (bright->power[bright->members[i]] > 0.0f)
            sum +=
                (double)bright->power[bright->members[i]] * density_to(&bright->points[bright->members[i]], origin, w);
    return sum > 0.0 ? chance * sum / cluster->power : 0.0;
}

void directed_weigh(const struct directed *d, struct tile_run_rays *rays, const struct rays_found *found,
                    uint32_t lanes)
{
    const struct kiln_bright *bright = d->p->bright;
    if (bright == NULL)
        return;
    for (uint32_t l = 0; l < lanes; l++)
        rays->weight[l] =
            d->to_patch[l] ? 0.0f : (float)(1.0 / (1.0 - d->receivers[d->receiver_of[rays->point[l]]].share));
    for (uint32_t i = 0; i < found->count; i++) {
        const uint32_t l = found->lane[i];
        const struct kiln_bright_receiver *r = &d->receivers[d->receiver_of[rays->point[l]]];
        const uint32_t cluster =
            found->point[i] != KILN_NO_POINT ? bright->cluster_of[found->point[i]] : KILN_NO_CLUSTER;
        if (!(r->share > 0.0) || cluster == KILN_NO_CLUSTER || (d->to_patch[l] && d->aimed_at[l] != cluster))
            continue;
        const double q = density_of(bright, r, rays, l, cluster), c = (double)rays->cosine[l] / KILN_PI;
        if (q > 0.0 && c > 0.0)
            rays->weight[l] = (float)(1.0 / (1.0 - r->share + r->share * q / c));
    }
}

uint32_t directed_quarter(const struct directed *d, const struct tile_run_rays *rays, uint32_t step, uint32_t l)
{
    const uint32_t k = step * rays->copies + rays->copy[l];
    const uint32_t by_cosine =
        d->p->bright != NULL ? d->receivers[d->receiver_of[rays->point[l]]].by_cosine : d->samples;
    return k < by_cosine ? (uint32_t)((uint64_t)k * RAY_QUARTERS / by_cosine)
                         : (uint32_t)((uint64_t)(k - by_cosine) * RAY_QUARTERS / (d->samples - by_cosine));
}
