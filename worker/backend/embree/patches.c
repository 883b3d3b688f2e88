/* The patches pass (worker/pass/patches.h). The rays of the gather pass measure the losses. Then each point processes
 * all nodes in order: shadow rays are traced to those that face it, eight at a time, unless the visibility is known
 * already (worker/pass/visibility_cache.h). */
#include "worker/pass/patches.h"

#include <math.h>

#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/patch_ray.h"
#include "worker/backend/embree/shadow.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"
#include "worker/pass/patch_factors.h"
#include "worker/pass/visibility_cache.h"

enum { WAITING = 64 };

/* Data that the pass's threads share. */
struct patches_job {
    const struct kiln_patches_parameters *p;
    const struct kiln_batch *part;
    const struct kiln_point_result *gathered; /* of the part's points: hits of their rays */
};

/* A node that faces the point, and is not known to be hidden. */
struct pair {
    const struct kiln_patch_node *node;
    struct kiln_patch_factors factors;
    int ray; /* index of its ray in the packet; below 0: visible without a ray */
};

/* Pairs whose rays are traced together, and the visible pairs between them, in the order of the nodes, in which they
 * are added. */
struct pairs {
    struct RTCRay8 rays __attribute__((aligned(32)));
    int valid[PACKET] __attribute__((aligned(32)));
    uint32_t ray_count, count;
    struct pair of[WAITING];
};

struct patches_work {
    struct tile_run_frame frame;
    struct patches_job job;
    struct pairs pairs;
    struct kiln_visibility_work visibility;
    /* of the point under way */
    uint32_t place; /* in the tile run */
    struct kiln_patch_receiver point;
    double albedo[3]; /* matters where factors are clamped */
    double row, incident[3], irradiance[3];
    uint64_t traced;
};

static void work_destroy(void **work)
{
    struct patches_work *w = *work;
    if (w != NULL)
        kiln_visibility_work_release(&w->visibility);
    kiln_free(work);
}

static int work_create(void **work, const struct embree_backend *b, const void *parameters,
                       const struct kiln_batch *part, struct kiln_error *error)
{
    (void)b, (void)part;
    struct patches_work *w = NULL;
    int status = kiln_allocate(&w, 1, sizeof *w, "the patches pass", error);
    if (status == KILN_OK) {
        w->job = *(const struct patches_job *)parameters;
        status = kiln_visibility_work_create(&w->visibility, w->job.p->cache, error);
    }
    *work = w;
    if (status != KILN_OK)
        work_destroy(work);
    return status;
}

/* ---- pairs ---- */

/* Adds the light of a node, times the share `through` of each colour. */
static void add_node(struct patches_work *w, const struct kiln_patch_node *node, double factor, double shading,
                     const double through[3])
{
    const struct kiln_patches_parameters *p = w->job.p;
    w->row += factor * (through[0] + through[1] + through[2]) / 3.0;
    for (int c = 0; c < 3; c++) {
        const double incident = factor * through[c] * (double)node->radiosity[c];
        /* what the clamp leaves of it */
        const double left = p->most_added > 0.0 && w->albedo[c] * incident > p->most_added
                                ? p->most_added / (w->albedo[c] * incident)
                                : 1.0;
        w->incident[c] += left * incident;
        w->irradiance[c] += left * shading * through[c] * (double)node->radiosity[c];
    }
}

/* Returns the result of a ray. */
static enum kiln_pairs seen_by(float end, const double through[3])
{
    return end < 0.0f                                                    ? KILN_PAIRS_SHUT
           : through[0] == 1.0 && through[1] == 1.0 && through[2] == 1.0 ? KILN_PAIRS_OPEN
                                                                         : KILN_PAIRS_PARTIAL;
}

static void trace(struct patches_work *w, const struct embree_backend *b, struct embree_context *context)
{
    static const double all[3] = {1.0, 1.0, 1.0};
    struct pairs *pairs = &w->pairs;
    double through[PACKET][3];
    for (uint32_t i = 0; i < PACKET; i++) {
        pairs->valid[i] = i < pairs->ray_count ? -1 : 0;
        through[i][0] = through[i][1] = through[i][2] = 1.0;
    }
    if (pairs->ray_count > 0)
        embree_through8(b, context, pairs->valid, &pairs->rays, through);
    for (uint32_t i = 0; i < pairs->count; i++) {
        const struct pair *pair = &pairs->of[i];
        const double *comes = pair->ray < 0 ? all : through[pair->ray];
        const enum kiln_pairs seen =
            pair->ray < 0 ? KILN_PAIRS_OPEN : seen_by(pairs->rays.tfar[pair->ray], through[pair->ray]);
        if (pair->ray >= 0)
            kiln_visibility_note(&w->visibility, w->place, pair->node->patch.number, seen);
        if (seen != KILN_PAIRS_SHUT)
            add_node(w, pair->node, pair->factors.factor, pair->factors.shading, comes);
    }
    w->traced += pairs->ray_count;
    pairs->ray_count = pairs->count = 0;
}

/* Computes the factors F of a node at d, whose squared length is `square`; both cosines are positive. */
static void find_factors(struct patches_work *w, const struct kiln_patch *from, struct kiln_dvec3 d, double square,
                         double cosine, double other, struct pair *pair)
{
    const double most = w->job.p->most_factor, far = (double)from->area * other / (KILN_PI * square * square);
    if (most > 0.0)
        pair->factors = (struct kiln_patch_factors){fmin(far * cosine, most),
                                                    fmin(far * fmax(0.0, dvec3_dot(w->point.s, d)), most)};
    else
        pair->factors = kiln_patch_factors(&w->point, from, d, square, cosine, other);
}

/* Makes the ray between a point and a node that face each other, unless they are known to see each other. False: they
 * are known not to, or coincide. */
static bool ask(struct patches_work *w, const struct kiln_patch *own, const struct kiln_patch *other, struct pair *pair)
{
    struct pairs *pairs = &w->pairs;
    const bool first = own->number < other->number;
    pair->ray = -1;
    if (own->number == other->number)
        return false;
    const enum kiln_pairs known = kiln_visibility_look(&w->visibility, w->place, other->number);
    if (known != KILN_PAIRS_UNKNOWN)
        return known == KILN_PAIRS_OPEN;
    /* both points use the same ray: from the one with the lower number */
    const struct kiln_patch *from = first ? own : other, *to = first ? other : own;
    if (w->job.p->voxels != NULL) {
        const bool open = kiln_voxels_open(w->job.p->voxels, from->place, from->normal, to->place, to->normal);
        kiln_visibility_note(&w->visibility, w->place, other->number, open ? KILN_PAIRS_OPEN : KILN_PAIRS_SHUT);
        return open;
    }
    if (!patch_ray(&pairs->rays, pairs->ray_count, from->place, to->place))
        return false;
    pair->ray = (int)pairs->ray_count++;
    return true;
}

static void gather_pairs(struct patches_work *w, const struct embree_backend *b, struct embree_context *context,
                         uint64_t point)
{
    const struct kiln_patches_parameters *p = w->job.p;
    const struct kiln_patch *own = &p->points[point];
    const double flat = KILN_PATCHES_FLAT * (double)b->params.geometry->extent;
    struct pairs *pairs = &w->pairs;
    for (uint64_t k = 0; k < p->count; k++) {
        const struct kiln_patch_node *node = &p->nodes[k];
        const struct kiln_dvec3 d = dvec3_sub(dvec3_of(node->centre), dvec3_of(own->place));
        const double cosine = dvec3_dot(w->point.n, d), other = -dvec3_dot(dvec3_of(node->patch.normal), d),
                     square = dvec3_dot(d, d);
        struct pair *pair = &pairs->of[pairs->count];
        if (!(cosine > flat && other > flat) || !ask(w, own, &node->patch, pair))
            continue;
        pairs->count++;
        pair->node = node;
        find_factors(w, &node->patch, d, square, cosine, other, pair);
        if (pairs->ray_count == PACKET || pairs->count == WAITING)
            trace(w, b, context);
    }
    if (pairs->count > 0)
        trace(w, b, context);
}

/* ---- points ---- */

static void begin_point(struct patches_work *w, const struct embree_backend *b, uint32_t j, uint64_t point,
                        struct kiln_own_point own)
{
    w->place = w->frame.place[j];
    const struct kiln_vec3 n = w->job.p->points[point].normal, s = frame_shading(&w->frame, j, n);
    w->point = (struct kiln_patch_receiver){dvec3_of(n), dvec3_of(s), w->frame.smooth};
    w->row = 0.0;
    for (uint64_t c = 0; c < 3; c++) {
        w->incident[c] = w->irradiance[c] = 0.0;
        w->albedo[c] = (double)b->surface->albedo[3 * own.at + c] / 65535.0;
    }
}

static void finish_point(const struct patches_work *w, const struct embree_backend *b, struct kiln_own_point own,
                         struct kiln_patches_result *r)
{
    const double row = w->job.p->most_factor > 0.0 ? 1.0
                       : w->job.p->shot != NULL
                           ? (double)b->surface->closing[KILN_CLOSING_FLOATS * own.at + KILN_CLOSING_SCALE]
                           : kiln_patches_row_scale(&r->point, w->row);
    const double scale = row * (double)r->point.count;
    for (int c = 0; c < 3; c++) {
        r->point.incident[c] = (float)(scale * w->incident[c]);
        r->point.irradiance[c] =
            (float)((double)r->point.count * kiln_patches_closed(row, w->incident[c], w->irradiance[c]));
    }
    r->point.error = 0.0f;
    r->row_scale = (float)row;
}

/* Mask of the points that are computed. */
static uint64_t places_of(const struct tile_run_frame *f)
{
    uint64_t places = 0;
    for (uint32_t j = 0; j < f->count; j++)
        places |= (uint64_t)1 << f->place[j];
    return places;
}

static void patches_tile_run(void *work, const struct embree_backend *b, struct embree_context *context,
                             size_t tile_run, void *results, uint64_t *rays)
{
    struct patches_work *w = work;
    const struct kiln_tile_run *run = &b->surface->tile_runs[tile_run];
    const uint64_t from = run->first.at - b->surface->tile_runs[w->job.part->first].first.at;
    frame_build(&w->frame, b, tile_run, kiln_batch_points(w->job.part, tile_run), 0);
    w->traced = 0;
    kiln_visibility_open(&w->visibility, w->job.p->cache, run, places_of(&w->frame));
    for (uint32_t j = 0; j < w->frame.count; j++) {
        const uint32_t place = w->frame.place[j];
        const uint64_t point = run->first.at + place;
        const struct kiln_own_point own = {kiln_own_of_global(b->surface, run->first).at + place};
        struct kiln_patches_result *r = (struct kiln_patches_result *)results + place;
        r->point = w->job.gathered[from + place];
        begin_point(w, b, j, point, own);
        gather_pairs(w, b, context, point);
        finish_point(w, b, own, r);
    }
    kiln_visibility_close(&w->visibility, w->job.p->cache, run, places_of(&w->frame));
    *rays += w->traced;
}

/* Reads back the ray statistics of own points, from the step that closed their rows. */
static void recall(const struct kiln_surface *s, uint64_t first, size_t points, uint32_t samples,
                   struct kiln_point_result *gathered)
{
    for (size_t i = 0; i < points; i++)
        gathered[i] = kiln_closing_rays(&s->closing[KILN_CLOSING_FLOATS * (first + i)], samples);
}

int embree_patches(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                   uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {work_create, work_destroy, patches_tile_run,
                                              sizeof(struct kiln_patches_result)};
    const struct kiln_patches_parameters *p = parameters;
    const struct kiln_tile_run *runs = b->surface->tile_runs + part->first;
    const size_t points = (size_t)kiln_tile_runs_points(runs, runs + part->count - 1);
    struct kiln_point_result *gathered = NULL;
    int status;
    KILN_TRY(kiln_allocate(&gathered, points, sizeof *gathered, "what the rays of patches meet", error));
    if (p->shot != NULL)
        recall(b->surface, kiln_own_of_global(b->surface, runs->first).at, points, part->samples, gathered);
    else
        KILN_TRY(embree_gather(b, NULL, part, gathered, rays, error));
    const struct patches_job job = {parameters, part, gathered};
    KILN_TRY(embree_each_tile_run(b, &pass, &job, part, results, rays, error));
end:
    kiln_free(&gathered);
    return status;
}
