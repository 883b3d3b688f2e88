/* kiln plan SCENE|JOB --ranks N: cells, balance, memory of a rank by purpose, time; bakes nothing. */
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "coordinator/bake/plan.h"
#include "coordinator/cli/agree.h"
#include "coordinator/cli/commands.h"
#include "coordinator/cli/temporary.h"

static double mebibytes(uint64_t bytes) { return (double)bytes / 1048576.0; }

static double node_memory(const struct kiln_job *job)
{
    if (job->node_memory > 0.0)
        return job->node_memory;
    return (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE) / 0x1p30;
}

static json_t *plan_json(const struct kiln_plan *p, const struct kiln_job *job)
{
    const struct kiln_plan_memory *m = &p->memory;
    json_t *memory = json_pack("{s:s, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I}", "units", "bytes", "program", (json_int_t)m->program, "textures",
                               (json_int_t)m->textures, "scene",
                               (json_int_t)m->scene, "geometry", (json_int_t)m->geometry, "bvh", (json_int_t)m->bvh, "surface_all",
                               (json_int_t)m->surface_all, "surface_own", (json_int_t)m->surface_own, "transport", (json_int_t)m->transport,
                               "volume", (json_int_t)m->volume, "total", (json_int_t)m->total);
    json_t *time = json_pack("{s:f, s:f, s:f, s:f, s:f, s:f, s:i}", "direct", p->seconds_direct, "bounces", p->seconds_bounces, "final",
                             p->seconds_final, "probes", p->seconds_probes, "exchange", p->seconds_exchange, "total", p->seconds,
                             "assumed_bounces", (int)p->bounces);
    json_t *disk = json_pack("{s:I, s:I, s:I}", "lightmaps", (json_int_t)p->lightmap_bytes, "kiln_h5", (json_int_t)p->h5_bytes, "volume",
                             (json_int_t)p->volume_bytes);
    return json_pack("{s:s, s:i, s:I, s:I, s:I, s:I, s:I, s:I, s:f, s:f, s:I, s:f, s:f, s:f, s:o, s:o, s:o}", "status", "done", "ranks",
                     (int)job->ranks, "triangles", (json_int_t)p->triangles, "points", (json_int_t)p->surface.points, "points_min",
                     (json_int_t)p->surface.points_min, "points_max", (json_int_t)p->surface.points_max, "cells_occupied",
                     (json_int_t)p->surface.cells_occupied, "cells_total", (json_int_t)p->surface.cells_total, "cell_size",
                     p->surface.cell_size, "imbalance", p->surface.imbalance, "probes", (json_int_t)p->probes, "bytes_per_point",
                     p->bytes_per_point, "bytes_per_triangle", p->bytes_per_triangle, "exchange_bytes_per_bounce", p->exchange_bytes,
                     "memory_per_rank", memory, "seconds", time, "disk_bytes", disk);
}

static void print_plan(const struct kiln_plan *p, const struct kiln_job *job)
{
    const struct kiln_plan_memory *m = &p->memory;
    (void)printf("%llu triangles, %llu surface points, %llu probes\n", (unsigned long long)p->triangles,
                 (unsigned long long)p->surface.points, (unsigned long long)p->probes);
    (void)printf("%llu cells of %g m, %llu of them occupied\n", (unsigned long long)p->surface.cells_total, p->surface.cell_size,
                 (unsigned long long)p->surface.cells_occupied);
    (void)printf("%u rank%s: %llu to %llu points each, imbalance %.1f %%\n\n", job->ranks, job->ranks == 1 ? "" : "s",
                 (unsigned long long)p->surface.points_min, (unsigned long long)p->surface.points_max, 100.0 * p->surface.imbalance);
    const struct {
        const char *name;
        uint64_t bytes;
    } rows[] = {{"program", m->program},           {"scene file, mapped", m->scene}, {"its images", m->textures}, {"geometry", m->geometry},
                {"BVH (estimated)", m->bvh},       {"tiles of all points", m->surface_all}, {"own surface points", m->surface_own},
                {"light of own points", m->transport}, {"probes", m->volume},        {"a rank in all", m->total}};
    (void)printf("memory of the fullest rank, MiB\n");
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        (void)printf("  %-22s %10.1f\n", rows[i].name, mebibytes(rows[i].bytes));
    (void)printf("%.1f bytes a surface point, %.1f bytes a triangle (BVH and images aside)\n", p->bytes_per_point, p->bytes_per_triangle);
    const double fits = node_memory(job) * 0x1p30 / (double)m->total;
    (void)printf("a node with %.1f GiB holds %s%.0f such ranks\n\n", node_memory(job), fits < 1.0 ? "only " : "", fits < 1.0 ? 0.0 : fits);
    (void)printf("time of the fullest rank, from a sample traced here (%u bounces assumed)\n", p->bounces);
    (void)printf("  direct %.2f s, bounces %.2f s, final gather %.2f s, probes %.2f s, exchange %.3f s: %.2f s\n", p->seconds_direct,
                 p->seconds_bounces, p->seconds_final, p->seconds_probes, p->seconds_exchange, p->seconds);
    (void)printf("  a rank receives %.1f MiB in each bounce\n", p->exchange_bytes / 1048576.0);
    (void)printf("results, before compression: lightmaps %.1f MiB, kiln.h5 %.1f MiB, volume.hdf %.1f MiB\n", mebibytes(p->lightmap_bytes),
                 mebibytes(p->h5_bytes), mebibytes(p->volume_bytes));
}

static int plan_here(struct kiln_job *job, const char *scene_file, struct kiln_error *error)
{
    struct kiln_prepared *prepared = NULL;
    struct kiln_phases phases = {0};
    struct kiln_plan plan;
    int status = kiln_prepare(&prepared, MPI_COMM_SELF, job, scene_file, &phases, NULL, error);
    if (status == KILN_OK)
        status = kiln_plan_make(&plan, prepared, job, error);
    if (status == KILN_OK && job->json) {
        json_t *object = plan_json(&plan, job);
        if (object == NULL || json_dumpf(object, stdout, JSON_COMPACT) != 0)
            status = kiln_fail(error, KILN_SYSTEM, "out of memory: the plan");
        (void)fputc('\n', stdout);
        json_decref(object);
    } else if (status == KILN_OK) {
        print_plan(&plan, job);
    }
    kiln_prepared_destroy(&prepared);
    return status;
}

int kiln_command_plan(struct kiln_job *job, struct kiln_error *error)
{
    int rank, status = KILN_OK;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    if (rank == 0) { /* one process plans for all */
        struct kiln_temporary temporary;
        status = kiln_temporary_make(&temporary, error);
        if (status == KILN_OK)
            status = plan_here(job, temporary.scene_file, error);
        kiln_temporary_remove(&temporary);
    }
    return kiln_agree(MPI_COMM_WORLD, status, error);
}
