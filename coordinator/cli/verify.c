/* kiln verify DIR: checks that every file of a finished bake is as it was written, and that its values are in range. */
#include <jansson.h>
#include <omp.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/bake/identity/transport_identity.h"
#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/files/publish.h"
#include "coordinator/output/read/ranges.h"
#include "coordinator/output/read/results.h"
#include "worker/base/memory.h"

struct verdict {
    int status;
    struct kiln_error error;
};

static int check_index(const char *directory, struct kiln_error *error)
{
    json_t *index;
    const int status = kiln_transport_index_read(&index, directory, error);
    json_decref(index);
    return status;
}

/* Checks one file: its hash and, if that is right, its values. Each thread has a reader of its own. */
static void check_file(const struct kiln_results *results, const char *directory, const struct kiln_manifest_file *file,
                       struct kiln_reader *reader, struct verdict *verdict)
{
    char path[KILN_PATH_SIZE];
    int descriptor;
    verdict->status = kiln_results_file(results, file->path, &descriptor, path, &verdict->error);
    if (verdict->status == KILN_OK && kiln_ranges_has(path))
        verdict->status = kiln_reader_ranges(reader, descriptor, path, &verdict->error);
    if (verdict->status == KILN_OK && strcmp(file->path, "transport/index") == 0)
        verdict->status = check_index(directory, &verdict->error);
    if (descriptor >= 0)
        (void)close(descriptor);
}

static int check_all(const struct kiln_results *results, const char *directory, struct verdict **verdicts,
                     struct kiln_error *error)
{
    const struct kiln_manifest *m = kiln_results_manifest(results);
    const int threads = omp_get_max_threads();
    struct kiln_reader **readers = NULL;
    int status = kiln_allocate(verdicts, m->count, sizeof **verdicts, "the files' verdicts", error);
    if (status == KILN_OK)
        status = kiln_allocate(&readers, (size_t)threads, sizeof *readers, "readers", error);
    for (int t = 0; status == KILN_OK && t < threads; t++)
        status = kiln_reader_create(&readers[t], 1, error);
    struct verdict *v = *verdicts;
#pragma omp parallel for schedule(dynamic, 1) if (status == KILN_OK)
    for (size_t i = 0; i < m->count; i++)
        if (status == KILN_OK)
            check_file(results, directory, &m->files[i], readers[omp_get_thread_num()], &v[i]);
    for (int t = 0; readers != NULL && t < threads; t++)
        kiln_reader_destroy(&readers[t]);
    kiln_free(&readers);
    return status;
}

static int print_json(struct kiln_job *job, const struct kiln_manifest *m, const struct verdict *v, size_t bad,
                      uint64_t bytes, struct kiln_error *error)
{
    json_t *problems = json_array();
    for (size_t i = 0; i < m->count; i++)
        if (v[i].status != KILN_OK)
            (void)json_array_append_new(problems, json_pack("{s:o, s:o}", "file", kiln_json_string(m->files[i].path),
                                                            "message", kiln_json_string(v[i].error.message)));
    job->answered = true;
    return kiln_json_print(json_pack("{s:s, s:I, s:I, s:I, s:o}", "status", bad == 0 ? "done" : "damaged", "files",
                                     (json_int_t)m->count, "bytes", (json_int_t)bytes, "damaged", (json_int_t)bad,
                                     "problems", problems),
                           error);
}

static int conclude(struct kiln_job *job, const struct kiln_manifest *m, const struct verdict *v,
                    struct kiln_error *error)
{
    size_t bad = 0;
    uint64_t bytes = 0;
    const char *first = NULL;
    for (size_t i = 0; i < m->count; i++) {
        bytes += m->files[i].bytes;
        bad += v[i].status != KILN_OK;
        if (v[i].status == KILN_OK)
            continue;
        first = first != NULL ? first : m->files[i].path;
        if (!job->json)
            (void)printf("%s\n", v[i].error.message);
    }
    const int status = job->json ? print_json(job, m, v, bad, bytes, error) : KILN_OK;
    if (bad > 0)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%zu of %zu files in %.500s cannot be trusted, %.200s first; bake again", bad, m->count,
                         job->arguments[0], first);
    if (!job->json && !job->quiet)
        (void)printf("%zu files, %.1f MiB: all as they were written, all values in range\n", m->count,
                     (double)bytes / 1048576.0);
    return status;
}

int kiln_command_verify(struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_results *results = NULL;
    struct verdict *verdicts = NULL;
    const char *directory = job->arguments[0];
    int status = kiln_results_open(&results, directory, error);
    if (status == KILN_NO_INPUT || (status == KILN_OK && kiln_results_manifest(results) == NULL))
        status = kiln_fail(error, KILN_NO_INPUT,
                           "%.500s has no manifest: the bake in it is not finished (kiln status says where it is)",
                           directory);
    if (status == KILN_OK)
        status = check_all(results, directory, &verdicts, error);
    if (status == KILN_OK)
        status = conclude(job, kiln_results_manifest(results), verdicts, error);
    kiln_free(&verdicts);
    kiln_results_close(&results);
    return status;
}
