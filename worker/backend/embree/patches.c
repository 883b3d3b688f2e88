/* The patches pass (worker/pass/patches.h): the gather pass's rays say what of them is lost, and then each point goes
 * through all nodes in their order; shadow rays go to those that face it, eight at a time. */
#include "worker/pass/patches.h"

#include <math.h>

#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/shadow.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"
#include "worker/light/view_factor.h"

/* What the pass's threads share. */
struct patches_job {
    const struct kiln_patches_parameters *p;
    const struct kiln_batch *part;
    const struct kiln_point_result *gathered; /* of the part's points: what their rays meet */
};

/* Pairs whose rays are traced together. */
struct pairs {
    struct RTCRay8 rays __attribute__((aligned(32)));
    int valid[PACKET] __attribute__((aligned(32)));
    uint32_t count;
    const struct kiln_patch_node *node[PACKET];
    double factor[PACKET], shading[PACKET]; /* F about the geometric and the shading normal */
};

struct patches_work {
    struct tile_run_frame frame;
    struct patches_job job;
    struct pairs pairs;
    /* of the point under way */
    struct kiln_dvec3 n, s; /* geometric and shading normal */
    bool smooth;            /* which differ */
    double albedo[3];       /* which counts where factors are clamped */
    double row, incident[3], irradiance[3];
    uint64_t traced;
};

static int work_create(void **work, const struct embree_backend *b, const void *parameters,
                       const struct kiln_batch *part, struct kiln_error *error)
{
    (void)b, (void)part;
    struct patches_work *w = NULL;
    const int status = kiln_allocate(&w, 1, sizeof *w, "the patches pass", error);
    if (status == KILN_OK)
        w->job = *(const struct patches_job *)parameters;
    *work = w;
    return status;
}

static void work_destroy(void **work) { kiln_free(work); }

/* ---- pairs ---- */

/* Adds what a node sends, of each colour the share `through`. */
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

static void trace(struct patches_work *w, const struct embree_backend *b, struct embree_context *context)
{
    struct pairs *pairs = &w->pairs;
    double through[PACKET][3];
    for (uint32_t i = 0; i < PACKET; i++) {
        pairs->valid[i] = i < pairs->count ? -1 : 0;
        through[i][0] = through[i][1] = through[i][2] = 1.0;
    }
    embree_through8(b, context, pairs->valid, &pairs->rays, through);
    for (uint32_t i = 0; i < pairs->count; i++)
        if (!(pairs->rays.tfar[i] < 0.0f))
            add_node(w, pairs->node[i], pairs->factor[i], pairs->shading[i], through[i]);
    w->traced += pairs->count;
    pairs->count = 0;
}

/* A ray between two places, the same whichever of the points asks: from the one with the lower number. False: they
 * are one place. */
static bool put_ray(struct pairs *pairs, uint32_t i, struct kiln_vec3 from, struct kiln_vec3 to)
{
    const struct kiln_vec3 d = vec3_sub(to, from);
    const float length = vec3_length(d);
    if (!(length > 0.0f))
        return false;
    pairs->rays.org_x[i] = from.x, pairs->rays.org_y[i] = from.y, pairs->rays.org_z[i] = from.z;
    pairs->rays.dir_x[i] = d.x / length, pairs->rays.dir_y[i] = d.y / length, pairs->rays.dir_z[i] = d.z / length;
    pairs->rays.tnear[i] = pairs->rays.time[i] = 0.0f;
    pairs->rays.tfar[i] = (float)((double)length * KILN_SHADOW_LENGTH);
    pairs->rays.mask[i] = ~0u;
    pairs->rays.flags[i] = 0;
    return true;
}

/* The mean over a parallelogram of n.d / |d|^4, over |d|^-4 at its middle, to the second order in its size: the other
 * cosine is the same all over it. */
static double mean_height(const struct kiln_patch *from, struct kiln_dvec3 n, struct kiln_dvec3 d, double square)
{
    const struct kiln_dvec3 edges[2] = {dvec3_of(from->edge_s), dvec3_of(from->edge_t)};
    const double height = dvec3_dot(n, d);
    double sum = height;
    for (int i = 0; i < 2; i++) {
        const double along = dvec3_dot(d, edges[i]) / square;
        sum += height * (along * along - dvec3_dot(edges[i], edges[i]) / (6.0 * square)) -
               dvec3_dot(n, edges[i]) * along / 3.0;
    }
    return fmax(0.0, sum);
}

/* Whether a patch at d counts as a polygon: it is near, or crosses the horizon. `square`: of the distance. */
static bool is_near(const struct patches_work *w, const struct kiln_patch *from, double cosine, double square)
{
    const double reach = fabs(dvec3_dot(w->n, dvec3_of(from->edge_s))) + fabs(dvec3_dot(w->n, dvec3_of(from->edge_t)));
    return square < KILN_PATCHES_NEAR * KILN_PATCHES_NEAR * (double)from->area || cosine < 0.5 * reach;
}

/* F of a node at d, a distance whose square is `square`; the cosines times the distance are above 0. */
static void find_factors(struct patches_work *w, const struct kiln_patch *from, struct kiln_dvec3 d, double square,
                         double cosine, double other, uint32_t i)
{
    const double most = w->job.p->most_factor, far = (double)from->area * other / (KILN_PI * square * square);
    double *factor = &w->pairs.factor[i], *shading = &w->pairs.shading[i];
    if (most > 0.0) {
        *factor = fmin(far * cosine, most);
        *shading = fmin(far * fmax(0.0, dvec3_dot(w->s, d)), most);
    } else if (is_near(w, from, cosine, square)) {
        const struct kiln_parallelogram near = {d, dvec3_of(from->edge_s), dvec3_of(from->edge_t)};
        *factor = kiln_view_factor_near(&near, w->n, w->n);
        *shading = w->smooth ? kiln_view_factor_near(&near, w->n, w->s) : *factor;
    } else {
        *factor = far * mean_height(from, w->n, d, square);
        *shading = w->smooth ? far * mean_height(from, w->s, d, square) : *factor;
    }
}

static void gather_pairs(struct patches_work *w, const struct embree_backend *b, struct embree_context *context,
                         uint64_t point)
{
    const struct kiln_patches_parameters *p = w->job.p;
    const struct kiln_patch *own = &p->points[point];
    for (uint64_t k = 0; k < p->count; k++) {
        const struct kiln_patch_node *node = &p->nodes[k];
        const struct kiln_dvec3 d = dvec3_sub(dvec3_of(node->centre), dvec3_of(own->place));
        const double cosine = dvec3_dot(w->n, d), other = -dvec3_dot(dvec3_of(node->patch.normal), d),
                     square = dvec3_dot(d, d);
        if (!(cosine > 0.0 && other > 0.0))
            continue;
        const bool first = own->number < node->patch.number;
        const uint32_t i = w->pairs.count;
        if (!put_ray(&w->pairs, i, first ? own->place : node->patch.place, first ? node->patch.place : own->place))
            continue;
        w->pairs.count++;
        w->pairs.node[i] = node;
        find_factors(w, &node->patch, d, square, cosine, other, i);
        if (w->pairs.count == PACKET)
            trace(w, b, context);
    }
    if (w->pairs.count > 0)
        trace(w, b, context);
}

/* ---- points ---- */

/* What the factors of the row are multiplied by: see worker/pass/patches.h. */
static double row_scale(const struct patches_work *w, const struct kiln_point_result *gathered)
{
    const struct kiln_point_mean mean = kiln_point_mean(gathered);
    const double samples = (double)mean.count, lost = (double)mean.escaped + (double)mean.blocked,
                 glass = ((double)mean.glass[0] + (double)mean.glass[1] + (double)mean.glass[2]) / 3.0,
                 chance = 3.0 * sqrt(fmax(0.0, lost * (1.0 - lost))) * pow(samples, -0.75),
                 off = fmax(0.0, 1.0 - lost - glass) - w->row;
    if (!(w->row > 0.0) || w->job.p->most_factor > 0.0)
        return 1.0;
    return 1.0 + off * (off != 0.0 ? fmax(0.0, 1.0 - chance * chance / (off * off)) : 0.0) / w->row;
}

static void begin_point(struct patches_work *w, const struct embree_backend *b, uint32_t j, uint64_t point,
                        struct kiln_own_point own)
{
    const struct kiln_vec3 n = w->job.p->points[point].normal, s = frame_shading(&w->frame, j, n);
    w->n = dvec3_of(n);
    w->s = dvec3_of(s);
    w->smooth = w->frame.smooth;
    w->row = 0.0;
    for (uint64_t c = 0; c < 3; c++) {
        w->incident[c] = w->irradiance[c] = 0.0;
        w->albedo[c] = (double)b->surface->albedo[3 * own.at + c] / 65535.0;
    }
}

static void patches_tile_run(void *work, const struct embree_backend *b, struct embree_context *context,
                             size_t tile_run, void *results, uint64_t *rays)
{
    struct patches_work *w = work;
    const struct kiln_tile_run *run = &b->surface->tile_runs[tile_run];
    const uint64_t from = run->first.at - b->surface->tile_runs[w->job.part->first].first.at;
    frame_build(&w->frame, b, tile_run, kiln_batch_points(w->job.part, tile_run), 0);
    w->traced = 0;
    for (uint32_t j = 0; j < w->frame.count; j++) {
        const uint32_t place = w->frame.place[j];
        const uint64_t point = run->first.at + place;
        struct kiln_point_result *r = (struct kiln_point_result *)results + place;
        *r = w->job.gathered[from + place];
        begin_point(w, b, j, point, (struct kiln_own_point){kiln_own_of_global(b->surface, run->first).at + place});
        gather_pairs(w, b, context, point);
        const double scale = row_scale(w, r) * (double)r->count;
        for (int c = 0; c < 3; c++) {
            r->incident[c] = (float)(scale * w->incident[c]);
            r->irradiance[c] = (float)(scale * w->irradiance[c]);
        }
        r->error = 0.0f;
    }
    *rays += w->traced;
}

int embree_patches(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                   uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {work_create, work_destroy, patches_tile_run,
                                              sizeof(struct kiln_point_result)};
    const struct kiln_tile_run *runs = b->surface->tile_runs + part->first;
    struct kiln_point_result *gathered = NULL;
    int status = kiln_allocate(&gathered, (size_t)kiln_tile_runs_points(runs, runs + part->count - 1), sizeof *gathered,
                               "what the rays of patches meet", error);
    if (status == KILN_OK)
        status = embree_gather(b, NULL, part, gathered, rays, error);
    const struct patches_job job = {parameters, part, gathered};
    if (status == KILN_OK)
        status = embree_each_tile_run(b, &pass, &job, part, results, rays, error);
    kiln_free(&gathered);
    return status;
}
