#include "coordinator/bake/plan.h"

#include <math.h>
#include <string.h>

#include "coordinator/bake/transport.h"
#include "coordinator/bake/volume.h"
#include "worker/base/memory.h"

/* Bounces that `--bounces all` is taken to make: rooms with albedo about 0.7 settle after 6 to 9. */
enum { TYPICAL_BOUNCES = 8, SAMPLE_RUNS = 16, RUN_FRAGMENTS = 8, SAMPLE_PROBES = 16 };

/* Embree 3.13, robust, medium quality: bytes of BVH a triangle, measured between 32 thousand and 4 million triangles. */
static const double BVH_BYTES = 100.0;
/* Resident size of a process with MPI, HDF5 and Embree before it has a scene, measured. */
static const uint64_t PROGRAM_BYTES = 60ull << 20;

static uint64_t share_bytes(const struct kiln_surface *s)
{
    const uint64_t pieces = s->piece_base != NULL && s->fragment_count > 0 ? s->piece_base[s->fragment_count] : 0;
    const uint64_t shares = s->share_base != NULL && s->fragment_count > 0 ? s->share_base[s->fragment_count] : 0;
    const uint64_t point = sizeof *s->piece_count + 3 * sizeof *s->albedo + sizeof *s->area + sizeof *s->visible;
    return s->count * point + pieces * sizeof *s->pieces + shares * sizeof *s->shares +
           s->fragment_count * (sizeof *s->fragments + sizeof *s->piece_base + sizeof *s->share_base);
}

static uint64_t section_bytes(const struct kiln_scene *scene, enum kiln_scene_section section)
{
    return scene->header->sections[section].count * kiln_scene_element_size(section);
}

static void plan_memory(struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_surface *share)
{
    struct kiln_plan_memory *m = &plan->memory;
    const struct kiln_geometry *g = p->geometry;
    m->program = PROGRAM_BYTES;
    m->textures = section_bytes(p->scene, KILN_SECTION_TEXELS) + section_bytes(p->scene, KILN_SECTION_ENVIRONMENT_TEXELS);
    m->scene = p->scene->mapped_bytes - m->textures;
    m->geometry = g->vertex_count * 3 * sizeof *g->vertices +
                  g->triangle_count * (3 * sizeof *g->indices + sizeof *g->records + sizeof *g->stored_triangle);
    m->bvh = (uint64_t)(BVH_BYTES * (double)g->triangle_count);
    m->surface_all = share->tile_count * sizeof *share->tiles + share->split_count * sizeof *share->splits +
                     p->scene->object_count * sizeof *share->lightmaps + (share->cell_first != NULL ? share->cell_count * sizeof *share->cell_first : 0);
    const double own = share->count > 0 ? (double)share_bytes(share) / (double)share->count : 0.0;
    m->surface_own = (uint64_t)(own * (double)plan->surface.points_max);
    m->transport = kiln_transport_bytes(plan->surface.points_max, plan->surface.points);
    m->volume = plan->probes * sizeof(struct kiln_probe_result);
    m->total = m->program + m->scene + m->textures + m->geometry + m->bvh + m->surface_all + m->surface_own + m->transport + m->volume;
    if (plan->surface.points > 0)
        plan->bytes_per_point = own + (double)m->surface_all / (double)plan->surface.points +
                                (double)(kiln_transport_bytes(plan->surface.points, plan->surface.points) - kiln_transport_bytes(0, 0)) /
                                    (double)plan->surface.points;
    if (g->triangle_count > 0)
        plan->bytes_per_triangle = (double)(m->scene + m->geometry) / (double)g->triangle_count;
}

/* Seconds of one point's direct pass and of one gather ray, from a sample of fragments spread over the scene. */
static int calibrate(const struct kiln_prepared *p, const struct kiln_job *job, double *direct, double *ray, struct kiln_error *error)
{
    const size_t count = p->surface->fragment_count;
    uint64_t *radiosity = NULL, rays = 0, unused = 0, points = 0;
    double seconds[2] = {0};
    int status = kiln_allocate(&radiosity, p->surface->point_count, sizeof *radiosity, "a sample's radiosity", error);
    if (status == KILN_OK)
        status = kiln_backend_set_radiosity(p->backend, radiosity, error);
    for (size_t run = 0; run < SAMPLE_RUNS && status == KILN_OK && count > 0; run++) {
        const size_t first = run * count / SAMPLE_RUNS;
        const struct kiln_batch batch = {first, count - first < RUN_FRAGMENTS ? count - first : RUN_FRAGMENTS, NULL, NULL};
        for (size_t f = first; f < first + batch.fragment_count; f++)
            points += p->surface->fragments[f].count;
        double start = MPI_Wtime();
        status = kiln_backend_direct(p->backend, &batch, job->samples_direct, &unused, error);
        seconds[0] += MPI_Wtime() - start;
        start = MPI_Wtime();
        if (status == KILN_OK)
            status = kiln_backend_gather(p->backend, &batch, 64, 1, &rays, error);
        seconds[1] += MPI_Wtime() - start;
    }
    *direct = points > 0 ? seconds[0] / (double)points : 0.0;
    *ray = rays > 0 ? seconds[1] / (double)rays : 0.0;
    kiln_free(&radiosity);
    return status;
}

static int probe_seconds(const struct kiln_prepared *p, const struct kiln_job *job, double *seconds, struct kiln_error *error)
{
    struct kiln_vec3 positions[SAMPLE_PROBES];
    struct kiln_probe_result results[SAMPLE_PROBES];
    uint64_t *radiosity = NULL, rays = 0;
    int status = kiln_allocate(&radiosity, p->surface->point_count, sizeof *radiosity, "a sample's radiosity", error);
    if (status == KILN_OK)
        status = kiln_backend_set_radiosity(p->backend, radiosity, error);
    const struct kiln_vec3 low = p->geometry->bounds_min, size = vec3_sub(p->geometry->bounds_max, low);
    for (int i = 0; i < SAMPLE_PROBES; i++) {
        const float t = ((float)i + 0.5f) / SAMPLE_PROBES;
        positions[i] = vec3(low.x + t * size.x, low.y + (1.0f - t) * size.y, low.z + t * size.z);
    }
    const double start = MPI_Wtime();
    if (status == KILN_OK)
        status = kiln_backend_probes(p->backend, positions, SAMPLE_PROBES, 0, job->samples_probe, results, &rays, error);
    *seconds = (MPI_Wtime() - start) / SAMPLE_PROBES;
    kiln_free(&radiosity);
    return status;
}

static int plan_time(struct kiln_plan *plan, const struct kiln_prepared *p, const struct kiln_job *job, struct kiln_error *error)
{
    double direct, ray, probe = 0.0;
    int status = calibrate(p, job, &direct, &ray, error);
    if (status == KILN_OK && plan->probes > 0)
        status = probe_seconds(p, job, &probe, error);
    const double points = (double)plan->surface.points_max, ranks = (double)job->ranks;
    const bool lean = job->schedule == KILN_SCHEDULE_LEAN;
    plan->bounces = job->bounces < 0 ? TYPICAL_BOUNCES : (uint32_t)job->bounces;
    const double before_final = plan->bounces > 0 ? (double)plan->bounces - 1.0 : 0.0;
    plan->seconds_direct = points * direct;
    plan->seconds_bounces = points * ray * (lean ? before_final * job->samples_bounce : (double)plan->bounces * job->samples_indirect);
    plan->seconds_final = lean && plan->bounces > 0 ? points * ray * job->samples_indirect : 0.0;
    plan->seconds_probes = probe * ceil((double)plan->probes / ranks);
    plan->exchange_bytes = ranks > 1.0 ? 8.0 * ((double)plan->surface.points - points) : 0.0;
    const double one = ranks > 1.0 ? plan->exchange_bytes / (job->node_bandwidth * 1e9) + ceil(log2(ranks)) * job->node_latency * 1e-6 : 0.0;
    plan->seconds_exchange = one * (plan->bounces + 1.0);
    plan->seconds = plan->seconds_direct + plan->seconds_bounces + plan->seconds_final + plan->seconds_probes + plan->seconds_exchange;
    return status;
}

int kiln_plan_make(struct kiln_plan *plan, const struct kiln_prepared *prepared, const struct kiln_job *job, struct kiln_error *error)
{
    *plan = (struct kiln_plan){.triangles = prepared->geometry->triangle_count};
    struct kiln_surface *share = NULL;
    const struct kiln_surface_params params = {.scene = prepared->scene,
                                               .geometry = prepared->geometry,
                                               .cell_size = job->cell_size,
                                               .partition = job->partition_objects ? KILN_PARTITION_OBJECTS : KILN_PARTITION_CELLS,
                                               .ranks = job->ranks,
                                               .threads = prepared->threads};
    int status = kiln_surface_build(&share, &params, &plan->surface, error);
    struct kiln_volume_result volume = {0};
    if (status == KILN_OK && job->samples_probe > 0)
        status = kiln_volume_grid(&volume, prepared->scene, job->probe_spacing, error);
    if (status == KILN_OK) {
        plan->probes = volume.size[0] * volume.size[1] * volume.size[2];
        plan_memory(plan, prepared, share);
        plan->lightmap_bytes = plan->surface.texels * 9 * (job->half ? 2u : 4u);
        plan->h5_bytes = plan->surface.points * 96;
        plan->volume_bytes = plan->probes * sizeof(struct kiln_probe_result);
        status = plan_time(plan, prepared, job, error);
    }
    kiln_surface_destroy(&share);
    return status;
}
