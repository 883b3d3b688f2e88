/* kiln relight: a bake of the same geometry under other light, whose rays are those that another bake has kept
 * (coordinator/integrate/transport.h). It has that bake's options, but for those that are given. */
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "coordinator/bake/bake.h"
#include "coordinator/bake/transport_identity.h"
#include "coordinator/cli/commands.h"
#include "coordinator/field/group_fields.h"
#include "coordinator/files/json.h"
#include "coordinator/job/changes.h"
#include "coordinator/job/light_groups.h"
#include "coordinator/job/options.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/read/results.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

/* Whether all files of transport that the manifest lists are there; without them rays would be traced in silence. */
static int check_files(const char *directory, struct kiln_error *error)
{
    struct kiln_results *results = NULL;
    int status = kiln_results_open(&results, directory, error);
    const struct kiln_manifest *manifest = status == KILN_OK ? kiln_results_manifest(results) : NULL;
    for (size_t i = 0; manifest != NULL && status == KILN_OK && i < manifest->count; i++) {
        const char *path = manifest->files[i].path;
        if (strncmp(path, "transport/", strlen("transport/")) == 0 && !kiln_results_has(results, path))
            status = kiln_fail(error, KILN_BAD_INPUT,
                               "'%.500s/%.200s' is missing: put it back, or bake again with --keep-transport",
                               directory, path);
    }
    kiln_results_close(&results);
    return status;
}

/* Rank 0 reads the index, the others receive it. Collective. */
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
        status = text != NULL ? check_files(directory, error)
                              : kiln_fail(error, KILN_SYSTEM, "out of memory: the index of the transport");
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

/* What many states from one load leave out, though the bake has it: it changes nothing of their light. */
static bool is_left_out(const struct kiln_job *job, const char *name)
{
    static const char *const left_out[] = {"light-groups", "sky-patches", "check-density"};
    bool is = false;
    for (size_t i = 0; i < sizeof left_out / sizeof *left_out; i++)
        is = is || strcmp(name, left_out[i]) == 0;
    return is && (job->states != NULL || job->listen);
}

static int take_string(struct kiln_job *job, const json_t *index, const char *key, char **to, struct kiln_error *error)
{
    const char *text = json_string_value(json_object_get(index, key));
    return kiln_job_keep_text(job, text != NULL ? text : "", to, error);
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
    if (kiln == NULL || strcmp(kiln, KILN_VERSION) != 0)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "the transport in %.500s was kept by kiln %.50s, and this is kiln %s: bake again", directory,
                         kiln != NULL ? kiln : "?", KILN_VERSION);
    int status = kiln_transport_options_take(job, index, directory, is_left_out, error);
    const char *other = job->argument_count > 1 ? job->arguments[1] : NULL;
    if (status == KILN_OK && other != NULL && kiln_is_yaml(other))
        job->changes = job->arguments[1];
    else if (other != NULL)
        job->changes = NULL;
    if (status == KILN_OK && other != NULL && !kiln_is_yaml(other))
        job->scene = job->arguments[1];
    else if (status == KILN_OK)
        status = take_string(job, index, "scene", &job->scene, error);
    if (status == KILN_OK)
        status = kiln_job_changes_read(job, error);
    if (status == KILN_OK)
        status = kiln_job_groups_read(job, error);
    if (status == KILN_OK)
        status = kiln_group_fields_make(job, error);
    if (status == KILN_OK)
        status = take_string(job, index, "instruction set", &job->instruction_set, error);
    if (status == KILN_OK && !kiln_job_given(job, kiln_option_find_for("backend", KILN_FOR_BAKE)))
        status = take_string(job, index, "backend", &job->backend, error); /* whose bits are the bake's */
    job->relight = directory;
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
    if (status == KILN_OK && job->states != NULL)
        status = kiln_agree(MPI_COMM_WORLD, rank == 0 ? print_states(bake, job, error) : KILN_OK, error);
    kiln_bake_end(&bake, status, error);
    return status;
}

int kiln_command_relight(struct kiln_job *job, struct kiln_error *error)
{
    json_t *index = NULL;
    int status = read_index(&index, job->arguments[0], error);
    if (status == KILN_OK)
        status = kiln_agree(MPI_COMM_WORLD, fill(job, index, error), error);
    json_decref(index);
    if (status == KILN_OK && (job->states != NULL || job->listen))
        return relight_states(job, error);
    return status == KILN_OK ? kiln_command_bake(job, error) : status;
}
