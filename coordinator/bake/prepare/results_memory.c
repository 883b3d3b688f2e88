#include "coordinator/bake/prepare/results_memory.h"

#include <math.h>
#include <stdio.h>

#include "coordinator/bake/reckon/preview_size.h"
#include "coordinator/bake/reckon/work.h"
#include "coordinator/field/result.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/kiln_h5_points.h"
#include "coordinator/output/map/write/lightmaps.h"
#include "coordinator/output/points_ahead.h"
#include "coordinator/run/host_memory.h"
#include "coordinator/run/process.h"
#include "coordinator/run/process_memory.h"

/* Measured memory for writing the results; units as each row's comment says. */
static const double LIGHTMAP_WORK = 65.0; /* bytes a texel of the lightmaps under way */
/* bytes per point sent to the writer of its lightmap; with several ranks as many again where it is received */
static const double RECORD_BYTES = 58.0;
/* bytes per point of kiln.h5 while it is written, and bytes of these that are still held afterwards */
static const double H5_ROW = 113.0, H5_KEPT = 90.0;
/* Compressed bytes of a point of kiln.h5, where several ranks write it. A rank keeps them until it knows where they
 * belong. Points packed ahead are not counted. */
static const double H5_PACKED = 28.5;
/* Bytes per texel of the fields in these measurements. Bytes of other fields are added. */
static const double MEASURED_PLANES = 28.0;
/* Bytes for denoising: planes of positions, normals and errors; scratch of a point. */
static const double DENOISE_PLANES = 32.0, DENOISE_WORK = 150.0;
/* Bytes of the neighbours that are kept of a point while it is denoised, up to KILN_LIGHTMAP_KEPT for a lightmap; the
 * part of these that bakes had in use when they took most; bytes of an own point that the allocator keeps of them
 * afterwards, and at most. */
static const double DENOISE_KEPT = 414.0, DENOISE_TOUCHED = 1.0 / 3.0, DENOISE_LEFT = 150.0,
                    DENOISE_LEFT_MOST = 7.0 * 0x1p20;
/* least bytes per surface point (worker/scene/surface.h): pieces, albedo, area, visibility */
static const double LEAST_OF_POINT = 18.0;
static const uint64_t ROWS_AT_ONCE = 1ull << 18;
/* Bytes of a preview, as bakes took: rays of a band; the picture, if nothing limits it; for gloss, the rays sent on and
 * the data for guides and grain. */
static const double PREVIEW_BYTES = 26.0 * 0x1p20, PREVIEW_PICTURE = 13.0 * 0x1p20, PREVIEW_GLOSS = 23.0 * 0x1p20;
static const double PREVIEW_TEXEL = 12.0; /* lightmaps in view */

uint64_t kiln_largest_lightmap(const struct kiln_scene *scene)
{
    uint64_t most = 0;
    for (size_t i = 0; i < scene->object_count; i++) {
        const uint64_t texels = (uint64_t)scene->objects[i].lightmap_width * scene->objects[i].lightmap_height;
        most = texels > most ? texels : most;
    }
    return most;
}

/* Bytes of a preview, except those for its lightmaps. */
static double preview_bytes(const struct kiln_job *job, const struct kiln_scene *scene, double points)
{
    return PREVIEW_BYTES + PREVIEW_PICTURE * kiln_preview_share(job, scene, points) +
           (scene->taken != NULL ? PREVIEW_GLOSS : 0.0);
}

uint64_t kiln_results_memory(const struct kiln_results_size *size)
{
    const double largest = (double)kiln_largest_lightmap(size->scene);
    struct kiln_field_set fields;
    kiln_field_set_choose(&fields, size->job);
    const uint32_t plane_count = (uint32_t)(kiln_field_set_plane_bytes(&fields) / sizeof(float));
    const double texels = size->texels / size->ranks,
                 at_once = fmax(largest, fmin(texels, (double)kiln_lightmap_texels(plane_count, texels)));
    const double rows = fmin(size->own, fmin((double)ROWS_AT_ONCE, 64.0 * (double)ROWS_AT_ONCE / plane_count));
    const bool denoises = kiln_job_denoises(size->job);
    const double planes =
                     (double)kiln_field_set_plane_bytes(&fields) - MEASURED_PLANES + (denoises ? DENOISE_PLANES : 0.0),
                 columns = (double)kiln_field_set_column_bytes(&fields) - KILN_RESULTS_COLUMNS;
    const double points_a_texel = size->texels > 0.0 ? size->points / size->texels : 1.0;
    /* not all lightmaps in work are denoised at the same time: the measurements fit one or two per thread */
    const double denoised = denoises ? fmin(at_once, 1.5 * size->threads * largest) * points_a_texel : 0.0;
    const double of_groups =
        24.0 * (double)size->job->scene.group_count; /* bytes per texel, and the same again for denoised copies */
    const double neighbours = DENOISE_TOUCHED * fmin(DENOISE_KEPT * denoised, 1.5 * size->threads * KILN_LIGHTMAP_KEPT);
    const double lightmaps = (LIGHTMAP_WORK + planes) * at_once + (DENOISE_WORK + of_groups) * denoised + neighbours +
                             (size->ranks > 1.0 ? 2.0 : 1.0) * (RECORD_BYTES + planes) * rows;
    const double preview = size->job->preview ? preview_bytes(size->job, size->scene, size->points) +
                                                    PREVIEW_TEXEL * size->texels + (H5_KEPT + columns) * rows
                                              : 0.0;
    const double kept =
        size->ranks > 1.0 ? fmin((H5_PACKED + columns) * size->own, (double)KILN_POINTS_KEPT_MOST) : 0.0;
    const double ahead =
        (double)KILN_POINTS_AHEAD_ROOM + fmin(KILN_POINTS_AHEAD_POINT * size->own, (double)KILN_POINTS_AHEAD_MOST);
    const double left = denoises ? fmin(DENOISE_LEFT * size->own, DENOISE_LEFT_MOST) : 0.0;
    return (uint64_t)(left + fmax(ahead + fmax(lightmaps, (H5_ROW + columns) * rows + kept), preview));
}

/* ---- the budget ---- */

/* Part of the memory left for points that the suggested density may fill. Measured memory differs from run to run, and
 * the suggestion must fit. */
static const double SURE = 0.75;

/* Memory of the host that takes most, bytes by purpose. */
struct host_need {
    double now;                            /* program, scene, BVH and surface points */
    double light, groups, results, probes; /* to come */
    double all, growing;                   /* the sum, and the part of it that grows with the points */
};

/* Collective. */
static struct host_need find_need(const struct kiln_prepared *p, const struct kiln_job *job, uint64_t probes)
{
    const struct kiln_surface *s = p->surface;
    struct kiln_field_set fields;
    kiln_field_set_choose(&fields, job);
    const double point = (double)kiln_field_set_point_bytes(&fields, KILN_FIELD_SURFACE);
    const uint64_t most = p->surface_report.points_max, of_host = most * (uint64_t)p->node_ranks;
    const double light = (double)kiln_field_set_light_bytes(
                     &fields, of_host < s->point_count ? of_host : s->point_count, s->point_count),
                 results = (double)kiln_results_memory(
                     &(struct kiln_results_size){.scene = p->scene,
                                                 .job = job,
                                                 .ranks = p->ranks,
                                                 .threads = p->threads,
                                                 .own = (double)most,
                                                 .points = (double)s->point_count,
                                                 .texels = (double)p->surface_report.texels});
    kiln_process_give_back();
    double now = ((double)kiln_process_memory(KILN_MEMORY_SHARE) + KILN_PASS_BYTES) * p->node_ranks;
    (void)MPI_Allreduce(MPI_IN_PLACE, &now, 1, MPI_DOUBLE, MPI_MAX, p->communicator);
    /* radiosity of light groups: each rank has that of all points */
    const double groups = (double)(p->node_ranks - 1) * (double)job->scene.group_count * 8.0 * (double)s->point_count;
    const double fixed = job->preview ? preview_bytes(job, p->scene, (double)s->point_count)
                                      : (double)KILN_POINTS_AHEAD_ROOM; /* of the results */
    const double probe = (double)(KILN_PROBE_BYTES + job->scene.group_count * sizeof(struct kiln_probe_group)),
                 of_probes = (double)probes / p->ranks * p->node_ranks * probe;
    return (struct host_need){.now = now,
                              .light = light,
                              .groups = groups,
                              .results = results,
                              .probes = of_probes,
                              .all = now + light + groups + results + of_probes,
                              .growing = light + groups + fmax(results - fixed, 0.0) + point * (double)of_host};
}

double kiln_memory_budget(const struct kiln_job *job)
{
    const double given = job->machine.memory_budget;
    return given > 0.0 ? given * 0x1p30 : given < 0.0 ? 0.0 : 0.875 * (double)kiln_host_memory();
}

uint64_t kiln_tree_memory(const struct kiln_job *job, int node_ranks)
{
    const double budget = kiln_memory_budget(job);
    return (uint64_t)((budget > 0.0 ? budget : (double)kiln_host_memory()) / 8.0 / node_ranks);
}

int kiln_points_memory_check(const struct kiln_scene *scene, const struct kiln_job *job, int ranks, int node_ranks,
                             struct kiln_error *error)
{
    const bool given = kiln_memory_budget(job) > 0.0;
    const double budget = given ? kiln_memory_budget(job) : (double)kiln_host_memory();
    double points = 0.0;
    size_t largest = 0;
    for (size_t i = 0; i < scene->object_count && job->lightmaps.store == KILN_STORE_KIND_LIGHTMAP; i++) {
        points += kiln_work_points_of(scene, i);
        largest = kiln_work_points_of(scene, i) > kiln_work_points_of(scene, largest) ? i : largest;
    }
    const double needed = points * LEAST_OF_POINT / ranks * node_ranks;
    if (!(budget > 0.0) || needed <= budget)
        return KILN_OK;
    const struct kiln_object *o = &scene->objects[largest];
    return kiln_fail(error, KILN_USAGE,
                     "the lightmaps have about %.0f million surface points, which take %.2f GiB on a host at least; %s "
                     "%.2f. Most are of object \"%.100s\", with a lightmap of %u x %u: give fewer --texels-per-metre, "
                     "or a smaller --lightmap-max",
                     points * 1e-6, needed / 0x1p30, given ? "--memory-budget is" : "it has", budget / 0x1p30,
                     kiln_scene_string(scene, o->name), o->lightmap_width, o->lightmap_height);
}

int kiln_memory_budget_check(const struct kiln_prepared *prepared, const struct kiln_job *job, uint64_t probes,
                             struct kiln_error *error)
{
    const double budget = kiln_memory_budget(job), density = (double)prepared->scene->header->texels_per_metre;
    char table[256], coarser[96], fewer[160] = "";
    if (!(budget > 0.0) || prepared->surface == NULL)
        return KILN_OK;
    const struct host_need n = find_need(prepared, job, probes);
    const double left = budget - (n.all - n.growing);
    if (n.all <= budget)
        return KILN_OK;
    (void)snprintf(table, sizeof table,
                   "program, scene, BVH and surface points %.2f, light %.2f, groups of lights %.2f, probes %.2f, "
                   "writing results %.2f",
                   n.now / 0x1p30, n.light / 0x1p30, n.groups / 0x1p30, n.probes / 0x1p30, n.results / 0x1p30);
    if (job->scene.group_count > 0)
        (void)snprintf(fewer, sizeof fewer,
                       "; it tells %zu groups of lights apart: use fewer groups or patches of the sky",
                       job->scene.group_count);
    if (!(left > 0.0))
        return kiln_fail(error, KILN_USAGE,
                         "the bake would take about %.2f GiB on a host (%s), of which the scene and its BVH alone take "
                         "%.2f; --memory-budget is %.2f: give it more (none: no limit), or use fewer ranks a host%s",
                         n.all / 0x1p30, table, (n.all - n.growing) / 0x1p30, budget / 0x1p30, fewer);
    if (density > 0.0)
        (void)snprintf(coarser, sizeof coarser, "--texels-per-metre %.3g in place of %.3g",
                       density * sqrt(SURE * left / n.growing), density);
    else
        (void)snprintf(coarser, sizeof coarser, "%.2g %% of its texels", 100.0 * SURE * left / n.growing);
    return kiln_fail(error, KILN_USAGE,
                     "the bake would take about %.2f GiB on a host (%s), and --memory-budget is %.2f (none: no limit): "
                     "with %s it would fit; so would a share of it on more hosts%s",
                     n.all / 0x1p30, table, budget / 0x1p30, coarser, fewer);
}
