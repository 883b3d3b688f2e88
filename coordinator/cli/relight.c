/* kiln relight: bakes the same geometry under other light, with the rays that another bake has kept
 * (coordinator/integrate/relight/transport.h). Options that define the light are taken from that bake unless they are
 * given. */
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/bake/bake.h"
#include "coordinator/bake/identity/transport_identity.h"
#include "coordinator/cli/commands.h"
#include "coordinator/field/group_fields.h"
#include "coordinator/files/folder.h"
#include "coordinator/files/json.h"
#include "coordinator/job/changes.h"
#include "coordinator/job/light_groups.h"
#include "coordinator/job/options.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/read/results.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"
#include "worker/base/version.h"

static bool is_transport(const char *path) { return strncmp(path, "transport/", strlen("transport/")) == 0; }

/* Compares a file of the transport with the manifest. */
static int check_file(const struct kiln_results *results, const char *directory, const char *name,
                      struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int descriptor;
    int status = kiln_results_file(results, name, &descriptor, path, error);
    if (descriptor >= 0)
        (void)close(descriptor);
    return status == KILN_NO_INPUT
               ? kiln_fail(error, KILN_BAD_INPUT,
                           "'%.500s/%.200s' is missing: put it back, or bake again with --keep-transport", directory,
                           name)
               : status;
}

/* Collective. Checks that all transport files of the manifest exist and are unchanged; otherwise rays would silently be
 * traced anew. Each rank reads some of them. */
static int check_files(const char *directory, struct kiln_error *error)
{
    struct kiln_results *results = NULL;
    int rank, ranks;
    size_t number = 0;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    (void)MPI_Comm_size(MPI_COMM_WORLD, &ranks);
    int status = kiln_results_open(&results, directory, error);
    const struct kiln_manifest *manifest = status == KILN_OK ? kiln_results_manifest(results) : NULL;
    for (size_t i = 0; manifest != NULL && status == KILN_OK && i < manifest->count; i++)
        if (is_transport(manifest->files[i].path) && number++ % (size_t)ranks == (size_t)rank)
            status = check_file(results, directory, manifest->files[i].path, error);
    kiln_results_close(&results);
    return kiln_agree(MPI_COMM_WORLD, status, error);
}

/* Collective. Reads the index on rank 0, and broadcasts it. */
static int read_index(json_t **index, const char *directory, struct kiln_error *error)
{
    int rank, status = KILN_OK;
    uint64_t size = 0;
    char *text = NULL, *sent = NULL;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    *index = NULL;
    if (rank == 0 && (status = kiln_transport_index_read(index, directory, error)) == KILN_OK) {
        (void)json_object_del(*index, "identity"); /* which the bake compares itself */
        text = json_dumps(*index, JSON_COMPACT);
        size = text != NULL ? strlen(text) : 0;
        if (text == NULL)
            status = kiln_fail(error, KILN_SYSTEM, "out of memory: the index of the transport");
    }
    status = kiln_agree(MPI_COMM_WORLD, status, error);
    if (status == KILN_OK)
        (void)MPI_Bcast(&size, 1, MPI_UINT64_T, 0, MPI_COMM_WORLD);
    if (status == KILN_OK)
        status = kiln_allocate(&sent, size + 1, 1, "the index of the transport", error);
    status = kiln_agree(MPI_COMM_WORLD, status, error);
    if (status == KILN_OK && rank == 0)
        memcpy(sent, text, size);
    if (status == KILN_OK)
        (void)MPI_Bcast(sent, (int)size, MPI_CHAR, 0, MPI_COMM_WORLD);
    if (status == KILN_OK && rank != 0 && (*index = json_loadb(sent, size, 0, NULL)) == NULL)
        status = kiln_fail(error, KILN_SYSTEM, "out of memory: the index of the transport");
    free(text);
    kiln_free(&sent);
    return kiln_agree(MPI_COMM_WORLD, status, error);
}

static bool same_folder(const char *a, const char *b)
{
    struct stat one, other;
    return stat(a, &one) == 0 && stat(b, &other) == 0 && one.st_dev == other.st_dev && one.st_ino == other.st_ino;
}

static int fill(struct kiln_job *job, const json_t *index, struct kiln_error *error)
{
    const char *directory = job->arguments[0], *kiln = json_string_value(json_object_get(index, "kiln"));
    if (same_folder(directory, job->output))
        return kiln_fail(error, KILN_USAGE, "%.500s is the folder of the bake that is relit: give another one with -o",
                         job->output);
    if (!kiln_version_has_same_bits(kiln))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "the transport in %.500s was kept by kiln %.50s, and this is kiln %s, whose rays are not the "
                         "same: relight it with kiln %.50s, or bake again with --keep-transport",
                         directory, kiln, KILN_VERSION, kiln);
    int status = kiln_transport_options_take(job, index, directory, error);
    const char *other = job->argument_count > 1 ? job->arguments[1] : NULL;
    const bool many =
        /* with states, groups of lights do not affect the light */
        job->relighting.states != NULL || job->relighting.listen;
    if (status == KILN_OK && other == NULL)
        status = kiln_transport_changes_take(job, index, directory, error);
    else if (status == KILN_OK && kiln_is_yaml(other))
        job->scene.changes = job->arguments[1];
    if (many && !kiln_job_given(job, kiln_option_find_for("sky-patches", KILN_FOR_BAKE)))
        job->scene.sky_patches = KILN_SKY_WHOLE;
    KILN_TRY(status);
    if (!many && job->scene.light_groups == NULL)
        KILN_TRY(kiln_transport_groups_take(job, index, directory, error));
    if (other != NULL && !kiln_is_yaml(other))
        job->scene.file = job->arguments[1];
    else
        KILN_TRY(kiln_transport_scene_take(job, index, directory, error));
    KILN_TRY(kiln_job_changes_read(job, error));
    KILN_TRY(kiln_job_groups_read(job, error));
    KILN_TRY(kiln_group_fields_make(job, error));
end:
    job->relighting.folder = directory;
    return status;
}

/* Rank 0. What each state has taken. */
static int print_states(const struct kiln_bake *bake, const struct kiln_job *job, struct kiln_error *error)
{
    const json_t *report = kiln_bake_report(bake), *states = json_object_get(report, "states");
    size_t i;
    json_t *one;
    if (job->json)
        return kiln_json_print(json_incref(kiln_bake_report(bake)), error);
    if (job->quiet)
        return KILN_OK;
    kiln_print(stdout, "loaded in %.2f s\n", json_real_value(json_object_get(report, "load_seconds")));
    kiln_print(stdout, "%-32s %10s %10s\n", "state", "solved, s", "written, s");
    json_array_foreach(states, i, one) kiln_print(
        stdout, "%-32s %10.3f %10.3f\n", json_string_value(json_object_get(one, "state")),
        json_real_value(json_object_get(one, "solve_seconds")), json_real_value(json_object_get(one, "write_seconds")));
    return KILN_OK;
}

/* Many states from one load. */
static int relight_states(struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_bake *bake;
    int rank;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    int status = kiln_bake_run(&bake, MPI_COMM_WORLD, job, error);
    if (status == KILN_OK && job->relighting.states != NULL)
        status = kiln_agree(MPI_COMM_WORLD, rank == 0 ? print_states(bake, job, error) : KILN_OK, error);
    kiln_bake_end(&bake, status, error);
    return status;
}

int kiln_command_relight(struct kiln_job *job, struct kiln_error *error)
{
    json_t *index = NULL;
    int status;
    KILN_TRY(check_files(job->arguments[0], error));
    KILN_TRY(read_index(&index, job->arguments[0], error));
    KILN_TRY(kiln_agree(MPI_COMM_WORLD, fill(job, index, error), error));
end:
    json_decref(index);
    if (status == KILN_OK && (job->relighting.states != NULL || job->relighting.listen))
        return relight_states(job, error);
    return status == KILN_OK ? kiln_command_bake(job, error) : status;
}
