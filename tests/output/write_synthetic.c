/* Writes the three files of a bake from a synthetic result; run by mpirun, so that tests can compare numbers of ranks.
 * Usage: write_synthetic DIR [half | divided | denoised | joined | loose | touching | rounds] [ahead | changed |
 * stopped | unkept]. divided: tall lightmaps with large holes, which are in bands of all ranks however small they are.
 * touching: the objects lie side by side. rounds: the same, but a rank has one lightmap at a time. joined: both
 * lightmaps are in bands, and touch; after "rounds-" each is made twice. denoised: as divided, and noise is taken out.
 * loose: as divided, and seams stay as they are. large-SIZE, large-denoised-SIZE: lightmaps of SIZE columns and as many
 * rows, or half as many, and no other files; prints for each rank what writing them took: seconds of the processor
 * outside MPI, and bytes that it held besides what it had; points-SIZE: the same of kiln.h5 alone. ahead: columns of
 * kiln.h5 are packed ahead, all of them, or those that are done when the threads are stopped at once; prints their
 * number. changed: all of them, and direct light is another one afterwards. unkept: no rank keeps what it has packed
 * for kiln.h5 until it knows where it belongs. */
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/output/exr.h"
#include "coordinator/output/map/write/lightmaps.h"
#include "coordinator/output/points_ahead.h"
#include "tests/common/synthetic.h"

/* ---- what writing takes ---- */

/* Seconds of the processor within those calls of MPI in which a rank waits for others. */
static double within_mpi;

static double processor_seconds(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* The linker puts these in place of the calls that they are named after. */
#define TIMED(name, parameters, arguments)                                                                             \
    int __real_MPI_##name parameters;                                                                                  \
    int __wrap_MPI_##name parameters;                                                                                  \
    int __wrap_MPI_##name parameters                                                                                   \
    {                                                                                                                  \
        const double begin = processor_seconds();                                                                      \
        const int done = __real_MPI_##name arguments;                                                                  \
        within_mpi += processor_seconds() - begin;                                                                     \
        return done;                                                                                                   \
    }

TIMED(Allreduce, (const void *from, void *to, int count, MPI_Datatype type, MPI_Op op, MPI_Comm comm),
      (from, to, count, type, op, comm))
TIMED(Alltoall,
      (const void *from, int count, MPI_Datatype type, void *to, int counts, MPI_Datatype types, MPI_Comm comm),
      (from, count, type, to, counts, types, comm))
TIMED(Waitall, (int count, MPI_Request requests[], MPI_Status statuses[]), (count, requests, statuses))
TIMED(Allgatherv,
      (const void *from, int count, MPI_Datatype type, void *to, const int *counts, const int *starts,
       MPI_Datatype types, MPI_Comm comm),
      (from, count, type, to, counts, starts, types, comm))
TIMED(Recv, (void *to, int count, MPI_Datatype type, int source, int tag, MPI_Comm comm, MPI_Status *status),
      (to, count, type, source, tag, comm, status))
TIMED(Send, (const void *from, int count, MPI_Datatype type, int target, int tag, MPI_Comm comm),
      (from, count, type, target, tag, comm))
TIMED(Exscan, (const void *from, void *to, int count, MPI_Datatype type, MPI_Op op, MPI_Comm comm),
      (from, to, count, type, op, comm))
TIMED(Sendrecv,
      (const void *from, int count, MPI_Datatype type, int target, int tag, void *to, int counts, MPI_Datatype types,
       int source, int tags, MPI_Comm comm, MPI_Status *status),
      (from, count, type, target, tag, to, counts, types, source, tags, comm, status))

/* The most memory that the process has had since forget_most, bytes. */
static double most_memory(void)
{
    char line[128];
    double kilobytes = 0.0;
    FILE *file = fopen("/proc/self/status", "r");
    while (file != NULL && fgets(line, sizeof line, file) != NULL)
        (void)sscanf(line, "VmHWM: %lf", &kilobytes);
    if (file != NULL)
        (void)fclose(file);
    return 1024.0 * kilobytes;
}

static void forget_most(void)
{
    const int file = open("/proc/self/clear_refs", O_WRONLY | O_CLOEXEC);
    if (file < 0 || write(file, "5", 1) != 1 || close(file) != 0)
        fprintf(stderr, "the most memory cannot be forgotten\n");
}

static int write_large(const struct kiln_bake_result *result, const struct kiln_output_params *params, bool points,
                       int rank, int ranks, struct kiln_error *error)
{
    static double told[64][2];
    struct kiln_lightmap_report reports[2];
    forget_most();
    within_mpi = 0.0;
    const double held = most_memory(), begin = processor_seconds();
    const int status =
        points ? kiln_write_h5(result, params, error) : kiln_write_lightmaps(result, params, reports, NULL, error);
    const double own[2] = {processor_seconds() - begin - within_mpi, most_memory() - held};
    if (status != KILN_OK || ranks > 64)
        return status;
    if (MPI_Gather(own, 2, MPI_DOUBLE, told, 2, MPI_DOUBLE, 0, MPI_COMM_WORLD) != MPI_SUCCESS)
        return KILN_RANK_LOST;
    for (int r = 0; rank == 0 && r < ranks; r++)
        printf("%d %.3f %.0f\n", r, told[r][0], told[r][1]);
    return KILN_OK;
}

/* ---- what is written ---- */

/* Radiance L(d) = 1 + d.y + 0.5 d.x d.z, in harmonics, brighter along x; probe 3 is inside geometry. */
static void make_probe(struct kiln_probe_result *probe, const uint64_t at[3], uint64_t index)
{
    const float scale = 1.0f + (float)at[0];
    for (int c = 0; c < 3; c++) {
        probe->radiance[0][c] = scale / 0.28209479f;
        probe->radiance[1][c] = scale / 0.48860251f;
        probe->radiance[7][c] = 0.5f * scale / 1.09254843f * (float)c;
        for (int a = 0; a < 6; a++)
            probe->irradiance_axes[a][c] = scale * (float)(a + 1) + 0.125f * (float)c;
    }
    probe->mean_distance = 0.5f + (float)at[2];
    probe->back_share = index == 3 ? 0.9f : 0.05f;
}

static bool is(const char *mode, const char *name) { return strcmp(mode, name) == 0; }

/* Makes large holes: of the first object every third row of tiles and what lies around it, of the second one square. */
static void make_holes(struct synthetic *s)
{
    const struct kiln_surface *f = &s->surface;
    for (size_t i = 0; i < f->tile_run_count; i++) {
        const struct kiln_tile_run *run = &f->tile_runs[i];
        const uint32_t x = run->tile % f->lightmaps[run->map].tiles_x, y = run->tile / f->lightmaps[run->map].tiles_x;
        if (run->map == 0 ? y % 7 < 4 : x > 4)
            memset(&f->visible[run->first.at - f->first.at], 0, run->count * sizeof *f->visible);
    }
}

static void scale_direct(struct synthetic *s, float factor)
{
    for (uint64_t i = 0; i < 3 * s->surface.count; i++)
        s->direct[i] *= factor;
}

/* Packs ahead, all or what is done at once. */
static void pack_ahead(struct kiln_points_ahead **ahead, struct synthetic *s, const struct kiln_bake_result *result,
                       const char *how)
{
    struct kiln_points_ahead_report report;
    const bool all = !is(how, "stopped");
    scale_direct(s, is(how, "changed") ? 2.0f : 1.0f);
    kiln_points_ahead_start(ahead, result, 8);
    kiln_points_ahead_direct(*ahead);
    do {
        (void)usleep(all ? 10000 : 0);
        kiln_points_ahead_report(*ahead, &report);
    } while (all && (report.chunks < report.of || report.direct < report.of));
    kiln_points_ahead_stop(*ahead);
    scale_direct(s, is(how, "changed") ? 0.5f : 1.0f);
    kiln_points_ahead_report(*ahead, &report);
    printf("ahead %llu %llu %llu %llu\n", (unsigned long long)report.chunks, (unsigned long long)report.direct,
           (unsigned long long)report.of, (unsigned long long)report.bytes);
}

static int write_all(const char *directory, const char *mode, const char *how, int rank, int ranks,
                     struct kiln_error *error)
{
    static struct synthetic s;
    const bool half = is(mode, "half"), joined = strstr(mode, "joined") != NULL,
               denoised = strstr(mode, "denoised") != NULL, points = strstr(mode, "points") != NULL,
               large = strstr(mode, "large") != NULL || points,
               divided = is(mode, "divided") || is(mode, "loose") || joined || denoised || large,
               rounds = strstr(mode, "rounds") != NULL;
    const char *dash = strrchr(mode, '-');
    unsigned size = 0;
    if (large && (dash == NULL || sscanf(dash, "-%u", &size) != 1))
        return kiln_fail(error, KILN_USAGE, "'%s' has no size", mode);
    int status = synthetic_create(&s, large ? size : 75, large ? size : divided ? 631 : 64, rank, ranks, error);
    if (status != KILN_OK)
        return status;
    if (half && s.surface.first.at == 0 && s.surface.count > 100)
        s.direct[0] = 70000.0f; /* must make the first object's file a float one */
    if (divided)
        make_holes(&s);
    if (is(mode, "touching") || rounds || joined)
        s.objects[1].transform[7] = 0.0; /* its left edge is the first one's */
    struct kiln_faults faults;
    status = kiln_faults_read(&faults, error);
    if (status != KILN_OK)
        return status;
    const struct kiln_bake_result result = synthetic_result(&s, MPI_COMM_WORLD);
    struct kiln_points_ahead *ahead = NULL;
    if (is(how, "ahead") || is(how, "changed") || is(how, "stopped"))
        pack_ahead(&ahead, &s, &result, how);
    const struct kiln_output_params params = {.directory = directory,
                                              .half = half,
                                              .stitch = !is(mode, "loose"),
                                              .denoise = denoised,
                                              .faults = &faults,
                                              .least_divided = divided ? 1 : 0,
                                              .ahead = ahead,
                                              .kept = is(how, "unkept") ? 1 : 0,
                                              .texel_budget = rounds ? 1 : 0,
                                              .provenance_json = "{\"seed\": 77, \"scene\": \"synthetic\"}"};
    if (large)
        return write_large(&result, &params, points, rank, ranks, error);
    struct kiln_lightmap_report reports[2];
    status = kiln_write_lightmaps(&result, &params, reports, NULL, error);
    for (int i = 0; status == KILN_OK && rank == 0 && i < 2; i++)
        printf("%u %llu %llu %llu %.9g %.9g\n", reports[i].map, (unsigned long long)reports[i].valid,
               (unsigned long long)reports[i].filled, (unsigned long long)reports[i].dilated,
               reports[i].seam_difference_before, reports[i].seam_difference_after);
    if (status == KILN_OK)
        status = kiln_write_h5(&result, &params, error);
    kiln_points_ahead_destroy(&ahead);
    struct kiln_volume_result volume = {.size = {5, 4, 3}, .origin = {-1, 0, 2}, .spacing = {0.5, 0.25, 1}};
    volume.first = 60 * (uint64_t)rank / (uint64_t)ranks;
    volume.count = 60 * (uint64_t)(rank + 1) / (uint64_t)ranks - volume.first;
    struct kiln_probe_result probes[60] = {0};
    struct kiln_probe_occluders occluders[60] = {0};
    struct kiln_probe_place places[60] = {0};
    for (uint64_t i = 0; i < volume.count; i++) {
        const uint64_t index = volume.first + i, at[3] = {index % 5, index / 5 % 4, index / 20};
        make_probe(&probes[i], at, index);
        occluders[i].planes[14][0] = 1.0f + (float)index;
        places[i] = (struct kiln_probe_place){{0.0f, (float)index, 0.0f}, index % KILN_PROBE_STATES};
    }
    volume.probes = probes;
    volume.occluders = occluders;
    volume.places = places;
    return status == KILN_OK ? kiln_write_volume(&result, &volume, &params, error) : status;
}

int main(int argc, char **argv)
{
    struct kiln_error error = {{0}};
    int rank = 0, ranks = 1;
    if (argc < 2 || MPI_Init(&argc, &argv) != MPI_SUCCESS || MPI_Comm_rank(MPI_COMM_WORLD, &rank) != MPI_SUCCESS ||
        MPI_Comm_size(MPI_COMM_WORLD, &ranks) != MPI_SUCCESS)
        return KILN_USAGE;
    const int status = write_all(argv[1], argc > 2 ? argv[2] : "", argc > 3 ? argv[3] : "", rank, ranks, &error);
    if (status != KILN_OK)
        fprintf(stderr, "rank %d: %d: %s\n", rank, status, error.message);
    (void)MPI_Finalize();
    return status;
}
